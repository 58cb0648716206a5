"""What each command does, as functions: the command line and Python call the same ones."""

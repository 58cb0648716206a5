"""Models of a device for other programs."""

"""Export of a device as a model for other programs."""

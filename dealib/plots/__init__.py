"""Pictures, from result files alone."""

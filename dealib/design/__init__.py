"""Designs: how results follow the numbers of a config."""

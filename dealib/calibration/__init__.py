"""Fitting parameters of a config to measured curves."""

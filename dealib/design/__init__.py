"""Designs: sensitivities, optimisation and uncertainty of a config."""

"""Measured curves: reading them with their units, and comparing runs with them."""

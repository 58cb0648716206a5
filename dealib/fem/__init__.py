"""The finite-element model; everything that needs dolfinx."""

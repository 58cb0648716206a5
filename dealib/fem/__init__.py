"""The finite-element model; everything that needs dolfinx."""

from dealib.fem import compat as compat

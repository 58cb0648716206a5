"""Material laws and what follows from them alone."""

from dealib.materials.laws import LAWS, Invariants, Law, invariants_of_stretches
from dealib.materials.prestretch import thickness_stretch

__all__ = ["LAWS", "Invariants", "Law", "invariants_of_stretches", "thickness_stretch"]

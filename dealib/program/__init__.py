"""Load programs: stages as generators of converged states, and runs that record them."""

from dealib.program.run import Observer, simulate
from dealib.program.simulation import Simulation, State

__all__ = ["Observer", "Simulation", "State", "simulate"]

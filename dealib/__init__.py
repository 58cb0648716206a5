"""dealib: dielectric elastomer actuators, from a YAML file to trustworthy curves and fields.

import dealib
case = dealib.load("configs/deap100.yaml", set={"geometry.film_thickness": "40 um"})
run = dealib.simulate(case)            # or: for state in dealib.Simulation(case): ...
run.history                            # pandas DataFrame
dealib.open("runs/deap100").fields(-1) # pyvista grid, without dolfinx
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from dealib.processor import prepare

if TYPE_CHECKING:
    from dealib.config import Case, load
    from dealib.design.optimise import optimise
    from dealib.design.sensitivity import sensitivities
    from dealib.design.uncertainty import uncertainty
    from dealib.errors import ConfigError, DealibError, Interrupted, NotConverged
    from dealib.program import Simulation, State, simulate
    from dealib.results.reader import Run
    from dealib.results.reader import Run as open
    from dealib.results.tables import load as tables
    from dealib.validation.suite import validate

__all__ = [
    "Case",
    "ConfigError",
    "DealibError",
    "Interrupted",
    "NotConverged",
    "Run",
    "Simulation",
    "State",
    "load",
    "open",
    "optimise",
    "sensitivities",
    "simulate",
    "tables",
    "uncertainty",
    "validate",
]

prepare()  # before numpy loads its BLAS

# name -> (module, attribute): imported when first asked for, since dolfinx takes seconds
_LAZY = {
    "Case": ("dealib.config", "Case"),
    "load": ("dealib.config", "load"),
    "ConfigError": ("dealib.errors", "ConfigError"),
    "DealibError": ("dealib.errors", "DealibError"),
    "Interrupted": ("dealib.errors", "Interrupted"),
    "NotConverged": ("dealib.errors", "NotConverged"),
    "Run": ("dealib.results.reader", "Run"),
    "open": ("dealib.results.reader", "Run"),
    "tables": ("dealib.results.tables", "load"),
    "optimise": ("dealib.design.optimise", "optimise"),
    "sensitivities": ("dealib.design.sensitivity", "sensitivities"),
    "uncertainty": ("dealib.design.uncertainty", "uncertainty"),
    "Simulation": ("dealib.program", "Simulation"),
    "State": ("dealib.program", "State"),
    "simulate": ("dealib.program", "simulate"),
    "validate": ("dealib.validation.suite", "validate"),
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'dealib' has no attribute {name!r}")
    module, attribute = _LAZY[name]
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted(__all__)

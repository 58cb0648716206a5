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
    from dealib.errors import ConfigError, DealibError, Interrupted, NotConverged, PlatformError
    from dealib.program import Simulation, State, simulate
    from dealib.results.reader import Run
    from dealib.results.reader import Run as open
    from dealib.results.tables import load as tables
    from dealib.tasks.doctor import doctor
    from dealib.tasks.files import reference, schema, template
    from dealib.tasks.fitting import calibrate
    from dealib.tasks.info import describe
    from dealib.tasks.measuring import compare, known_materials, law, read_data, sense
    from dealib.tasks.pictures import animate, plot, show, write_report
    from dealib.tasks.progress import Progress
    from dealib.tasks.solving import bias, export_tables, modes, respond, write_mesh
    from dealib.tasks.studies import run_study
    from dealib.validation.suite import validate

__all__ = [
    "Case",
    "ConfigError",
    "DealibError",
    "Interrupted",
    "NotConverged",
    "PlatformError",
    "Progress",
    "Run",
    "Simulation",
    "State",
    "animate",
    "bias",
    "calibrate",
    "compare",
    "describe",
    "doctor",
    "export_tables",
    "known_materials",
    "law",
    "load",
    "modes",
    "open",
    "optimise",
    "plot",
    "read_data",
    "reference",
    "respond",
    "run_study",
    "schema",
    "sense",
    "sensitivities",
    "show",
    "simulate",
    "tables",
    "template",
    "uncertainty",
    "validate",
    "write_mesh",
    "write_report",
]

prepare()  # before numpy loads OpenBLAS

# name -> (module, attribute), imported at first use: importing dolfinx takes seconds
_LAZY = {
    "Case": ("dealib.config", "Case"),
    "load": ("dealib.config", "load"),
    "ConfigError": ("dealib.errors", "ConfigError"),
    "DealibError": ("dealib.errors", "DealibError"),
    "Interrupted": ("dealib.errors", "Interrupted"),
    "NotConverged": ("dealib.errors", "NotConverged"),
    "PlatformError": ("dealib.errors", "PlatformError"),
    "Run": ("dealib.results.reader", "Run"),
    "open": ("dealib.results.reader", "Run"),
    "tables": ("dealib.results.tables", "load"),
    "optimise": ("dealib.design.optimise", "optimise"),
    "sensitivities": ("dealib.design.sensitivity", "sensitivities"),
    "uncertainty": ("dealib.design.uncertainty", "uncertainty"),
    "Simulation": ("dealib.program", "Simulation"),
    "State": ("dealib.program", "State"),
    "simulate": ("dealib.program", "simulate"),
    "Progress": ("dealib.tasks.progress", "Progress"),
    "bias": ("dealib.tasks.solving", "bias"),
    "export_tables": ("dealib.tasks.solving", "export_tables"),
    "modes": ("dealib.tasks.solving", "modes"),
    "respond": ("dealib.tasks.solving", "respond"),
    "write_mesh": ("dealib.tasks.solving", "write_mesh"),
    "animate": ("dealib.tasks.pictures", "animate"),
    "plot": ("dealib.tasks.pictures", "plot"),
    "show": ("dealib.tasks.pictures", "show"),
    "write_report": ("dealib.tasks.pictures", "write_report"),
    "calibrate": ("dealib.tasks.fitting", "calibrate"),
    "compare": ("dealib.tasks.measuring", "compare"),
    "known_materials": ("dealib.tasks.measuring", "known_materials"),
    "law": ("dealib.tasks.measuring", "law"),
    "read_data": ("dealib.tasks.measuring", "read_data"),
    "sense": ("dealib.tasks.measuring", "sense"),
    "run_study": ("dealib.tasks.studies", "run_study"),
    "reference": ("dealib.tasks.files", "reference"),
    "schema": ("dealib.tasks.files", "schema"),
    "template": ("dealib.tasks.files", "template"),
    "doctor": ("dealib.tasks.doctor", "doctor"),
    "describe": ("dealib.tasks.info", "describe"),
    "validate": ("dealib.validation.suite", "validate"),
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("dealib")
    if name not in _LAZY:
        raise AttributeError(f"module 'dealib' has no attribute {name!r}")
    module, attribute = _LAZY[name]
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])

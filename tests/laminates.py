"""Small devices of the tests: configs of laminates, and their runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dealib import Case, Simulation
from dealib.config import Config, resolved

FILM = {"law": "neo_hookean", "youngs_modulus": "1 MPa", "relative_permittivity": 3.0}
ELECTRODE = {"law": "neo_hookean", "youngs_modulus": "1 MPa"}
BASES = {
    "annulus": {"kind": "annulus", "inner_radius": "6 mm", "outer_radius": "10 mm"},
    "disc": {"kind": "disc", "radius": "10 mm"},
    "tube": {"kind": "tube", "inner_radius": "4 mm", "length": "10 mm"},
    "strip": {"kind": "strip", "length": "10 mm", "width": "5 mm"},
}
COARSE = {"columns": 8, "film_rows": 1}


def layer(name: str = "film", thickness: str = "0.5 mm", **keys: Any) -> dict[str, Any]:
    """A layer."""
    return {"name": name, "thickness": thickness, **keys}


def config(base: str, *layers: dict[str, Any], **sections: Any) -> Config:
    """A config of layers, a film alone by default, on one of `BASES`."""
    return Config.model_validate(
        {
            "name": "device",
            "geometry": {
                "shape": "laminate",
                "base": BASES[base],
                "layers": list(layers) or [layer()],
                **sections.pop("geometry", {}),
            },
            "mesh": COARSE | sections.pop("mesh", {}),
            "materials": {"film": FILM, "electrode": ELECTRODE} | sections.pop("materials", {}),
            "program": [{"stage": "rest"}],
            **sections,
        }
    )


def simulation(given: Config) -> Simulation:
    """A simulation of a config."""
    return Simulation(Case(given, resolved(given), Path()))


def rows(given: Config) -> list[dict[str, Any]]:
    """Rows of its history."""
    return [state.row for state in simulation(given)]

"""What is probably not meant in a config, though it can be solved: told as warnings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dealib.config.schema import Config
from dealib.config.wave import reach
from dealib.device.facing import facing_none
from dealib.log import LOGGER
from dealib.units import EPSILON_0

_STRENGTH = 1000.0  # MV/m, above the breakdown strength of any film
_BEYOND = 10.0  # times a breakdown strength or a modulus, at which a load is absurd
_SQUEEZED = 100.0  # Maxwell stress over the shear modulus, likewise


def doubts(config: Config) -> list[str]:
    """Warnings about a config, each with the key that it is about."""
    found = [*_unused(config), *_geometry(config), *_loads(config)]
    return [f"{where}: {problem}" for where, problem in found]


def warn(config: Config) -> None:
    """Warn of what is probably not meant."""
    for text in doubts(config):
        LOGGER.warning("%s", text)


def _unused(config: Config) -> Iterator[tuple[str, str]]:
    used = {region.material for region in config.device.regions}
    for name in config.materials:
        if name not in used:
            yield f"materials.{name}", "no part of the device is made of it"
    for name in facing_none(config.device, config.mesh):
        problem = "no film lies between it and another electrode, so that its voltage does nothing"
        yield f"terminals.{name}", problem


def _geometry(config: Config) -> Iterator[tuple[str, str]]:
    laminate = config.device.laminate
    if laminate is None:
        return
    first, last = laminate.base.limits
    round_ = laminate.base.along == "R" and first == 0  # a disc spans its diameter
    span = 2 * last if round_ else last - first
    for layer in laminate.layers:
        if not layer.conducts and layer.thickness > span:
            problem = f"{layer.name!r} is thicker ({layer.thickness:g} mm) than its span"
            yield "geometry", f"{problem} ({span:g} mm); check the units"


def _loads(config: Config) -> Iterator[tuple[str, str]]:
    """Voltages and pressures that no film bears."""
    laminate, solids = config.device.laminate, config.solids
    films = [x for x in laminate.layers if not x.conducts] if laminate is not None else []
    stiffest = max(material.shear_modulus_at_rest for material in solids.values())
    for i, stage in enumerate(config.program):
        for path, _, _, given in stage.inputs:
            for name, course in given.courses:
                where = ".".join(map(str, ("program", i, *path, *name)))
                largest = max(map(abs, reach(course)), default=0.0)
                if name[-1] == "voltage" and films:
                    film = min(films, key=lambda x: x.thickness)
                    yield from _field(config, where, largest, film)
                if name[-1] == "pressure" and largest > _BEYOND * stiffest:
                    problem = (
                        f"{_round(1e3 * largest)} kPa are {_round(largest / stiffest)} times the "
                    )
                    yield where, problem + "largest shear modulus of the device; check the unit"


def _field(config: Config, where: str, voltage: float, film: Any) -> Iterator[tuple[str, str]]:
    """Whether a voltage over the thinnest film is absurd."""
    field, material = voltage / film.thickness, config.materials[film.material]
    strength = config.limits.breakdown
    squeeze = EPSILON_0 * material.permittivity.at(1.0) * field**2 / material.shear_modulus_at_rest
    over = f"{_round(voltage)} kV over the film of {film.thickness:g} mm are {_round(field)} MV/m"
    if strength is not None and field > _BEYOND * strength:
        yield (
            where,
            f"{over}, {_round(field / strength)} times its breakdown strength; check the unit",
        )
    elif field > _STRENGTH:
        yield where, f"{over}, which no film bears; check the unit"
    elif squeeze > _SQUEEZED:
        problem = f"{over}, whose stress is {_round(squeeze)} times the film's shear modulus"
        yield where, f"{problem}; check the unit"


def _round(number: float) -> str:
    """A number with three digits, such as 1,230."""
    return f"{float(f'{number:.3g}'):,.15g}"

"""The numbers of a config by their keys, and configs in which some of them are changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from dealib.config.messages import problem
from dealib.config.schema import Config
from dealib.errors import ConfigError, Place, did_you_mean
from dealib.units import split

_PHYSICAL = ("geometry", "materials", "terminals", "mounts", "chambers", "damping", "limits")
_PROGRAM = ("sensing", "physics", "program")
_TIMES = "duration"  # key that has an effect only if results depend on time


@dataclass(frozen=True)
class Key:
    """A number of a config, or the equal numbers of a list.

    Attributes:
        path: Keys and list positions.
        value: Value in `unit`.
        unit: dealib's internal unit; empty for plain numbers.
    """

    path: Place
    value: float
    unit: str

    @property
    def name(self) -> str:
        """The path with dots, as for `--set`."""
        return ".".join(map(str, self.path))


def keys(config: Config, wanted: Sequence[str] = ()) -> list[Key]:
    """Numbers of a config other than zero.

    Args:
        config: The config.
        wanted: Names of numbers or of sections; default all numbers that the file gives, except
            those of mesh, solver, output, probes and conditions.

    Raises:
        ConfigError: If there is no such number, or it is zero.
    """
    given = list(_numbers(_tree(config, config.model_dump(exclude_unset=True, exclude_none=True))))
    if not wanted:
        chosen = (k for k in given if k.path[0] in (*_PHYSICAL, *_PROGRAM) and k.value)
        return [k for k in chosen if in_time(config) or k.path[-1] != _TIMES]
    every = list(_numbers(config.model_dump(exclude_none=True)))
    known = {k.name: k for k in (*every, *given)}
    found: dict[str, Key] = {}
    for name in wanted:
        inside = [k for k in given if k.name.startswith(f"{name}.") and k.value]
        if name in known:
            inside = [known[name]]
        if not inside:
            raise ConfigError(f"the config has no number {name!r}{did_you_mean(name, known)}")
        if not inside[0].value:
            raise ConfigError(f"{name} is 0 and cannot be changed by a share of itself")
        found |= {k.name: k for k in inside}
    return list(found.values())


def in_time(config: Config) -> bool:
    """Whether results depend on durations without inertia: by viscosity or by openings."""
    flows = any(port.openings for port in config.device.ports)
    return flows or any(material.memory for material in config.solids.values())


def moved(config: Config, factors: Mapping[Key, float], also: Mapping[str, Any] = {}) -> Config:
    """The config with some numbers multiplied by factors.

    Args:
        config: The config.
        factors: Factor of each number.
        also: Further changes: keys and values by section.

    Raises:
        ConfigError: If that is not a valid config.
    """
    tree = config.model_dump(exclude_none=True)
    if any(key.path[-1] == "youngs_modulus" for key in factors):
        tree = _tree(config, tree)
    for key, factor in factors.items():
        tree = _scaled(tree, key.path, factor)
    for section, given in also.items():
        tree[section] = tree.get(section, {}) | given
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(problem(error.errors()[0])) from None


def _tree(config: Config, tree: dict[str, Any]) -> dict[str, Any]:
    """A dumped config with Young's moduli in place of the moduli that follow from them."""
    found = dict(tree["materials"])
    for name, material in config.materials.items():
        if material.youngs_modulus is not None:
            kept = {k: v for k, v in found[name].items() if k not in material.ruled()}
            found[name] = kept | {"youngs_modulus": f"{material.youngs_modulus!r} MPa"}
    return tree | {"materials": found}


def _numbers(node: Any, path: Place = ()) -> Iterator[Key]:
    """Numbers of a dumped config; a list of equal numbers counts as one number."""
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _numbers(value, (*path, name))
        return
    if isinstance(node, (list, tuple)):
        inner = [key for k, item in enumerate(node) for key in _numbers(item, (*path, k))]
        flat = len(inner) == len(node) and all(len(k.path) == len(path) + 1 for k in inner)
        if flat and inner and len({(k.value, k.unit) for k in inner}) == 1:
            yield Key(path, inner[0].value, inner[0].unit)
            return
        yield from inner
        return
    if isinstance(node, float):
        yield Key(path, node, "")
    elif isinstance(node, str) and (number := _quantity(node)) is not None:
        yield Key(path, *number)


def _quantity(text: str) -> tuple[float, str] | None:
    """Number and unit of a quantity in the form that dealib writes; None for other texts."""
    try:
        value, unit = split(text)
    except ValueError:
        return None
    return (value, unit) if text == f"{value!r} {unit}" else None


def _scaled(node: Any, path: Place, factor: float) -> Any:
    """A tree with the number at a path multiplied by a factor."""
    if path:
        name, *rest = path
        inner = _scaled(node[name], tuple(rest), factor)
        if isinstance(node, dict):
            return {**node, name: inner}
        return [inner if k == name else item for k, item in enumerate(node)]
    if isinstance(node, (list, tuple)):
        return [_scaled(item, (), factor) for item in node]
    if isinstance(node, str):
        value, unit = split(node)
        return f"{value * factor!r} {unit}"
    return node * factor

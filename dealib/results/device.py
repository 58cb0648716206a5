"""Whether several runs are of the same device, judged by their configs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dealib.errors import ConfigError
from dealib.results.reader import Run
from dealib.section import leaves

if TYPE_CHECKING:
    from dealib.config.schema import Config

_PARTS = {"geometry", "mesh", "materials", "physics"}  # the rest is how it is driven and solved
_TOLD = 4  # differing keys


def check_device(runs: Sequence[Run]) -> None:
    """Check that runs are of one device whose state depends on displacement and voltage alone.

    Raises:
        ConfigError: If the devices differ (the message names the keys), or if a material depends on
            its history.
    """
    first, *others = devices = [_device(run.config) for run in runs]
    for run, device in zip(runs[1:], others, strict=True):
        keys = [k for k in {**first, **device} if first.get(k) != device.get(k)]
        if keys:
            told = [
                f"{k} ({first.get(k, 'not given')}, {device.get(k, 'not given')})"
                for k in keys[:_TOLD]
            ]
            told += [f"{len(keys) - _TOLD} keys more"] if len(keys) > _TOLD else []
            raise ConfigError(
                f"no map: {runs[0].directory} and {run.directory} differ in {', '.join(told)}"
            )
    for key in devices[0]:
        if key.endswith((".branches.0.shear_modulus", ".mullins.r", ".permanent_set.energy")):
            key = key.removesuffix(".0.shear_modulus").removesuffix(".r").removesuffix(".energy")
            raise ConfigError(
                f"{runs[0].directory}: no map: {key} make the capacitance depend on what came "
                "before; run it without them"
            )


def _device(config: Config) -> dict[str, Any]:
    """Dotted keys and values, without the names of materials' entries in the library."""
    found = leaves(config.model_dump(include=_PARTS, exclude_none=True))
    return {key: value for key, value in found if not key.endswith(".library")}

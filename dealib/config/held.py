"""What nothing holds, as far as names tell; the mesh tells the rest (see `dealib.fem.rigid`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dealib.device.device import Device
from dealib.device.records import RIGID, not_held
from dealib.errors import ValueAt

if TYPE_CHECKING:
    from dealib.config.program import Stage

_LOADS = ("force", "mass")


def check_held(program: Sequence[Stage], device: Device) -> None:
    """Raise `ValueAt` if in some stage nothing holds the device along an axis.

    Whether it may turn depends on where its supports are, which only its mesh tells.
    """
    loaded = set[str]()
    _check(device, loaded)
    for stage in program:
        for name, given in stage.driven(device).items():
            (loaded.add if given.given[0] in _LOADS else loaded.discard)(name)
        if stage.follow is not None:  # it drives both of its ports in its own way
            loaded.clear()
        if not stage.dynamic:
            _check(device, loaded)


def _check(device: Device, loaded: set[str]) -> None:
    axes = device.kinematics.axes
    for axis in axes[1:] if device.kinematics.revolved else axes:
        ports = (
            f"{s.port}.{axis}" if s.kind == RIGID else s.port
            for s in device.supports
            if s.quantity == axis
        )
        if loaded.issuperset(ports):
            raise ValueAt(("holds",), not_held(f"along {axis}"))

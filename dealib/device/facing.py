"""Which terminals of a laminate face another one across a film."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from dealib.device.count import centres
from dealib.device.device import Device
from dealib.device.laminate import Laminate
from dealib.device.records import PHI, TERMINAL

# lower and upper level of a piece of an electrode, and the points of the base that it covers
_Piece = tuple[int, int, Any]


def facing_none(device: Device, mesh: Any) -> list[str]:
    """Names of the terminals between which and any other conductor there is no film.

    Devices with air are left out, in which a field passes beside the film, and meshes from files.

    Args:
        device: The device.
        mesh: The config's section.
    """
    laminate = device.laminate
    if laminate is None or laminate.air_height > 0:
        return []
    at = centres(laminate, mesh)
    pieces, electrodes = _pieces(laminate, at), defaultdict[str, list[_Piece]](list)
    for support in device.supports:
        if support.quantity == PHI:
            if support.where not in pieces:  # on an end of the base
                return []
            electrodes[support.port] += pieces[support.where]
    return [
        port.name
        for port in device.of(TERMINAL)
        if not port.floating
        and not any(
            _face(laminate, at, mine, other)
            for name, others in electrodes.items()
            if name != port.name
            for mine in electrodes[port.name]
            for other in others
        )
    ]


def _pieces(laminate: Laminate, at: Any) -> dict[str, list[_Piece]]:
    """Where conducting layers, faces and parts of faces are, by name."""
    found = defaultdict[str, list[_Piece]](list)
    for k, layer in enumerate(laminate.layers):
        found[layer.name].append((k, k + 1, laminate.covered(layer, at)))
    for names, level, mask in laminate.interfaces(at):
        for name in names:
            found[name].append((level, level, mask))
    return found


def _face(laminate: Laminate, at: Any, one: _Piece, other: _Piece) -> bool:
    """Whether a film lies between two pieces somewhere."""
    (_, low, below), (high, _, above) = sorted((one, other), key=lambda piece: piece[:2])
    both = below & above
    return any(
        (both & laminate.covered(layer, at)).any()
        for layer in laminate.layers[low:high]
        if not layer.conducts
    )

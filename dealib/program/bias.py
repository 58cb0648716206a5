"""The force curve of a bias's second film, by simulation; and a warning beyond given ranges."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from dealib.config.bias import Sampled, SecondFilm, second_device
from dealib.config.case import Case, resolved
from dealib.config.schema import Config
from dealib.device.records import MOUNT
from dealib.program.engine import Engine

log = logging.getLogger(__name__)


def second_film(
    config: Config, film: SecondFilm, simulate: Callable[[Case], Iterable[Any]]
) -> Sampled:
    """Force of a mirrored second film on the mount, by its stretch beyond flat (collective).

    Args:
        config: Config of the device that it biases.
        film: The second film.
        simulate: Yields the states of a case.

    Returns:
        Displacements, mm, and forces, N.

    Raises:
        NotConverged: If the second film cannot be displaced as far as the config asks.
    """
    device = second_device(config, film)
    log.info("simulating the second film of the bias")
    rows = [state.row for state in simulate(Case(device, resolved(device), Path()))]
    # pushed down by -x it pulls its own mount up by -F; mirrored, it pulls this one down by F
    x = [-row["displacement_mm"] for row in rows]
    force = [row["force_N"] for row in rows]
    x[0] = force[0] = 0.0
    return Sampled(
        displacement=(*(-v for v in reversed(x[1:])), *x),
        force=(*(-f for f in reversed(force[1:])), *force),
    )


class ReachWatch:
    """Warns once if a mount leaves the range for which a bias element is given."""

    def __init__(self) -> None:
        self._said = False

    def see(self, row: dict[str, Any], of: Engine) -> None:
        """Look at a state.

        Args:
            row: The history's row.
            of: The engine, at this state.
        """
        for port in of.problem.device.of(MOUNT):
            at = of.newton.system.values[port.name]
            for element, anchor in of.newton.system.ports[port.name].elements:
                low, high = getattr(element, "reach", (-float("inf"), float("inf")))
                if not self._said and not low <= at - anchor <= high:
                    self._said = True
                    log.warning(
                        "step %d (%s): the mount at %.5g mm is outside the range of a bias element "
                        "(%.5g to %.5g mm), whose force is extrapolated linearly there",
                        *(row["step"], row["stage"], at, low + anchor, high + anchor),
                    )

"""What biases the mount, beyond the elements themselves: a second film is measured by a run."""

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
        config: Of the device that it biases.
        film: The second film.
        simulate: Gives the states of a case.

    Raises:
        NotConverged: If the second film cannot be pushed so far.
    """
    device = second_device(config, film)
    log.info("the second film of the bias is measured")
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
    """Warns once if a mount leaves what a bias element is known for."""

    def __init__(self) -> None:
        self._said = False

    def see(self, row: dict[str, Any], of: Engine) -> None:
        """Look at a state.

        Args:
            row: The history's row.
            of: What the state is of.
        """
        for port in of.problem.device.of(MOUNT):
            at = of.newton.system.values[port.name]
            for element, anchor in of.newton.system.ports[port.name].elements:
                low, high = getattr(element, "reach", (-float("inf"), float("inf")))
                if not self._said and not low <= at - anchor <= high:
                    self._said = True
                    log.warning(
                        "step %d (%s): the mount at %.5g mm is beyond what a bias element is given "
                        "for (%.5g to %.5g mm); its force goes on straight there",
                        *(row["step"], row["stage"], at, low + anchor, high + anchor),
                    )

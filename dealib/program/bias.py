"""What biases the mount, beyond the elements themselves: a second film is measured by a run."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dealib.config.bias import Sampled, SecondFilm, second_device
from dealib.config.case import Case, resolved
from dealib.config.schema import Config
from dealib.fem.system import PortLaw

log = logging.getLogger(__name__)


def second_film(config: Config, comm: MPI.Comm, film: SecondFilm) -> Sampled:
    """Force of a mirrored second film on the mount, by its stretch beyond flat (collective).

    Raises:
        NotConverged: If the second film cannot be pushed so far.
    """
    from dealib.program.simulation import Simulation

    device = second_device(config, film)
    log.info("the second film of the bias is measured")
    rows = [state.row for state in Simulation(Case(device, resolved(device), Path()), comm)]
    # pushed down by -x it pulls its own mount up by -F; mirrored, it pulls this one down by F
    x = [-row["displacement_mm"] for row in rows]
    force = [row["force_N"] for row in rows]
    x[0] = force[0] = 0.0
    return Sampled(
        displacement=(*(-v for v in reversed(x[1:])), *x),
        force=(*(-f for f in reversed(force[1:])), *force),
    )


class ReachWatch:
    """Warns once if the mount leaves what a bias element is known for."""

    def __init__(self) -> None:
        self._said = False

    def see(self, row: dict[str, Any], law: PortLaw) -> None:
        """Look at a state.

        Args:
            row: The history's row.
            law: The mount's equation.
        """
        for element, anchor in law.devices:
            low, high = getattr(element, "reach", (-float("inf"), float("inf")))
            if not self._said and not low <= row["displacement_mm"] - anchor <= high:
                self._said = True
                log.warning(
                    "step %d (%s): the mount at %.5g mm is beyond what a bias element is given "
                    "for (%.5g to %.5g mm); its force goes on straight there",
                    *(row["step"], row["stage"], row["displacement_mm"]),
                    *(low + anchor, high + anchor),
                )

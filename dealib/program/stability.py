"""A warning when the film comes near the stretch at which its law loses stability."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

import numpy as np

from dealib.fem.snapshot import Snapshot
from dealib.materials.laws import Law
from dealib.materials.response import MODES, stability_limit, stiffness

log = logging.getLogger(__name__)

MARGIN = 0.05  # of the stretches


class StabilityWatch:
    """Warns once, and once more if the limit itself is passed.

    Args:
        laws: The films' laws.
    """

    def __init__(self, laws: Iterable[Law]) -> None:
        self.laws = [w for w in laws if any(np.isfinite(stability_limit(w, m)) for m in MODES)]
        self._said: set[str] = set()

    def see(self, row: dict[str, Any], snapshot: Snapshot) -> None:
        """Look at a state, and warn if need be (collective).

        Args:
            row: The history's row.
            snapshot: The state.
        """
        for state in snapshot.states if self.laws else ():
            if state.film.law in self.laws:
                mine = np.stack(state.film.stretches(state.k.F), axis=-1).reshape(-1, 2)
                stretches = np.concatenate(snapshot.comm.allgather(mine))
                self._judge(row, state.film.law, stretches)

    def _judge(self, row: dict[str, Any], law: Law, stretches: Any) -> None:
        for share, said in ((1.0, "is beyond"), (1 - MARGIN, "is within 5 % of")):
            lost = stiffness(law, *(stretches / share).T) <= 0
            if not lost.any():
                continue
            if said in self._said:
                return
            self._said |= {"is within 5 % of", said}
            first, second = stretches[lost][stretches[lost].max(axis=1).argmax()]
            log.warning(
                "step %d (%s): the film, stretched by %.3f x %.3f, %s the stability limit of its "
                "law; beyond it stress falls with further stretching, and results depend on the "
                "mesh (see dealib materials)",
                *(row["step"], row["stage"], first, second, said),
            )
            return

"""A warning when the film comes near the stretch at which its law is not stable any more."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from dealib.materials.laws import Law
from dealib.materials.response import MODES, stability_limit, stiffness

log = logging.getLogger(__name__)

MARGIN = 0.05  # of the stretches


class StabilityWatch:
    """Warns once, and once more if the limit itself is passed.

    Args:
        law: The film's law.
    """

    def __init__(self, law: Law) -> None:
        self.law = law
        self.active = any(np.isfinite(stability_limit(law, mode)) for mode in MODES)
        self._said: set[str] = set()

    def see(self, row: dict[str, Any], measure: Callable[[], Any]) -> None:
        """Look at a state, and warn if need be.

        Args:
            row: The history's row.
            measure: Gives the in-plane stretches at the film's points, shape (points, 2).
        """
        if not self.active:
            return
        stretches = measure()
        for share, said in ((1.0, "is beyond"), (1 - MARGIN, "is within 5 % of")):
            lost = stiffness(self.law, *(stretches / share).T) <= 0
            if not lost.any():
                continue
            if said in self._said:
                return
            self._said |= {"is within 5 % of", said}
            first, second = stretches[lost][stretches[lost].max(axis=1).argmax()]
            log.warning(
                "step %d (%s): the film, stretched by %.3f x %.3f, %s the stability limit of its "
                "law; beyond it stretching on asks for less stress, and results depend on the mesh "
                "(see dealib materials)",
                *(row["step"], row["stage"], first, second, said),
            )
            return

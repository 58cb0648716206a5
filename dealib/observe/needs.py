"""Conditions on a config for quantities to be recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dealib.materials.laws import LAWS
from dealib.materials.response import softens


@dataclass(frozen=True)
class Need:
    """A condition on the config for a quantity to be recorded.

    Attributes:
        text: The condition in words.
        has: Whether a config meets it.
    """

    text: str
    has: Callable[[Any], bool]


def _films(config: Any) -> list[Any]:
    return [m for name, m in config.solids.items() if not config.conducts(name)]


ALWAYS = Need("", lambda config: True)
STRENGTH = Need("limits.breakdown_strength", lambda c: c.limits.breakdown is not None)
WEIBULL = Need("limits.weibull", lambda c: c.limits.weibull is not None)
STRETCH = Need("limits.stretch_max", lambda c: c.limits.stretch_max is not None)
SOFTENING = Need(
    "a film that can lose its stiffness, such as mooney_rivlin with c01 below 0",
    lambda c: any(softens(film) for film in _films(c)),
)
LOCKING = Need(
    f"a film whose law locks: {' or '.join(n for n, law in LAWS.items() if law.locks)}",
    lambda c: any(film.locks for film in _films(c)),
)
DIFFERENTIAL = Need("sensing.differential: true", lambda c: c.sensing.differential)
LADDER = Need(
    "sensing.sheet_resistance, of a laminate in two dimensions with one terminal",
    lambda c: c.sensing.sheet_resistance is not None and c.device.ladder,
)
BRANCHES = Need(
    "Maxwell branches, such as materials.film.branches",
    lambda c: any(law.branches for law in c.solids.values()),
)
MEMORY = Need(
    "a material with branches, mullins or permanent_set",
    lambda c: any(law.memory for law in c.solids.values()),
)
TENSION_FIELD = Need(
    "physics.wrinkling: tension_field", lambda c: c.physics.wrinkling == "tension_field"
)
TAUT = Need("physics.wrinkling: taut", lambda c: c.physics.wrinkling == "taut")
MOVES = Need("a stage with dynamic: true", lambda c: c.moves)
DAMPED = Need(
    f"{MOVES.text}, and damping", lambda c: c.moves and (c.damping.mass or c.damping.stiffness)
)
CHARGING = Need("sensing.charging: true", lambda c: c.sensing.charging)
FOLLOW = Need("a stage with follow", lambda c: any(s.follow is not None for s in c.program))
AUTO = Need("a stage with steps: auto", lambda c: any(s.auto for s in c.program))
WATCHED = Need("output.modes above 0", lambda c: c.output.modes > 0)
COUNTED = Need(f"{WATCHED.text}, or {FOLLOW.text}", lambda c: WATCHED.has(c) or FOLLOW.has(c))

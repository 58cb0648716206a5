"""The largest use of each limit over a run, with its place and time."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Any

from dealib.fem.snapshot import Extremum
from dealib.log import PASSING
from dealib.results.summary import GIVEN

log = logging.getLogger(__name__)


def keep(
    worst: dict[str, dict[str, Any]],
    peaks: Mapping[str, Extremum],
    row: dict[str, Any],
    axes: tuple[str, ...],
) -> None:
    """Update the largest uses with a state; warn if it is the first beyond a limit of the config.

    Args:
        worst: `use`, position such as `R_mm`, `step`, `time_s` and `stage` by margin; is updated.
        peaks: Largest uses in the state.
        row: The state's row of the history.
        axes: Names of the mesh's coordinates.
    """
    for name, peak in peaks.items():
        before = worst[name]["use"] if name in worst else -1e300
        if not peak.value > before + 1e-9 * abs(before):  # rounding is no new maximum
            continue
        worst[name] = {
            "use": peak.value,
            **{f"{axis}_mm": x for axis, x in zip(axes, peak.at, strict=True)},
            **{key: row[key] for key in ("step", "time_s", "stage")},
        }
        if before <= 1 < peak.value and name in GIVEN:
            log.warning(
                "step %d (%s): %s = %.4g, beyond the limit of the config, at %s",
                *(row["step"], row["stage"], name, peak.value),
                ", ".join(f"{a} = {x:.4g} mm" for a, x in zip(axes, peak.at, strict=True)),
                extra=PASSING,  # the summary tells the largest value
            )


def table(worst: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """The largest uses for `run.json`, each with `ok`; an infinite `use` is null."""
    return {
        name: {
            **found,
            "use": found["use"] if math.isfinite(found["use"]) else None,
            "ok": found["use"] <= 1 + 1e-9,
        }
        for name, found in worst.items()
    }

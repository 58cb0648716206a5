"""The worst of each margin over a run: how much is used, where, when."""

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
    """Take a state into account, and warn when it is the first beyond a limit of the config.

    Args:
        worst: By margin: `use`, the position such as `R_mm`, `step`, `time_s`, `stage`; is updated.
        peaks: Of the state.
        row: Its row of the history.
        axes: Names of the mesh's coordinates.
    """
    for name, peak in peaks.items():
        before = worst[name]["use"] if name in worst else -1e300
        if not peak.value > before + 1e-9 * abs(before):  # not by rounding alone
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
    """For `run.json`: with `ok`; a `use` without bound is null."""
    return {
        name: {
            **found,
            "use": found["use"] if math.isfinite(found["use"]) else None,
            "ok": found["use"] <= 1 + 1e-9,
        }
        for name, found in worst.items()
    }

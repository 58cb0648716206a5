"""What an engineer asks of a history first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.errors import ConfigError
from dealib.results import stages
from dealib.units import neat

if TYPE_CHECKING:
    import pandas

    from dealib.results.reader import Run


def under_voltage(history: pandas.DataFrame) -> pandas.Series[bool]:
    """Whether there is a voltage, row by row, rounding apart."""
    voltage = history["voltage_kV"].abs()
    return voltage > 1e-9 * voltage.max()


def stored_note(run: Run) -> str:
    """What to know of the stored steps: there was a voltage, but none is stored; else ''."""
    under = under_voltage(run.history)
    stored = run.history["step"].isin(run.stored_steps)
    return "no state under voltage was stored" if under.any() and not (under & stored).any() else ""


def moment(run: Run, row: Mapping[str, Any] | pandas.Series[Any]) -> str:
    """Step, time and stage of a state: 'step 21, t = 25 s, actuate'.

    Args:
        run: The run.
        row: `step`, `time_s` and `stage`.
    """
    timed = stages.clock(run.config.program) == "time_s"
    time = f", t = {neat(row['time_s'], 4)} s" if timed else ""
    return f"step {row['step']}{time}, {row['stage']}"


@dataclass(frozen=True)
class Actuation:
    """What the voltage did in one stage, against the state just before it.

    Attributes:
        stage: Name of the stage, numbered if there are several of it.
        peak_voltage: kV.
        stroke: Largest change of the displacement, mm; None where the mount is held.
        force_change: Largest change of the force on a mount that is held, N; else None.
    """

    stage: str
    peak_voltage: float
    stroke: float | None = None
    force_change: float | None = None


def actuations(run: Run) -> list[Actuation]:
    """One entry for each stage under voltage, in order, but where the mount is led somewhere."""
    h, program = run.history, run.config.program
    number = stages.numbers(h, program, run.info.get("stops", ()))
    titles, drives = stages.titles(program), stages.mount_drives(program)
    under = under_voltage(h).to_numpy()
    found = []
    for k in np.unique(number[under]):
        rows = np.flatnonzero(under & (number == k))
        part = h.iloc[[max(rows[0] - 1, 0), *rows]]
        at = part[["displacement_mm", "force_N"]].to_numpy()
        stroke, force = (float(c) for c in np.abs(at - at[0]).max(axis=0))
        peak = float(part["voltage_kV"].abs().max())
        if drives[k] not in stages.LED:
            found.append(Actuation(titles[k], peak, stroke=stroke))
        elif drives[k] == "displacement" and stroke < 1e-6:
            found.append(Actuation(titles[k], peak, force_change=force))
    return found


@dataclass(frozen=True)
class CriticalPoint:
    """A special state of a branch that was followed.

    Attributes:
        stage: Name of the stage, numbered if there are several of it.
        what: 'limit point' or 'bifurcation'.
        vary: The variable that was set free, such as 'voltage'.
        value: Of it, in its unit.
        unit: kV, uC, mm or N.
        displacement: Of the mount, mm.
        modes: Number of unstable modes before and after it; none where the branch ends there.
    """

    stage: str
    what: str
    vary: str
    value: float
    unit: str
    displacement: float
    modes: tuple[int, int | None]

    @property
    def name(self) -> str:
        """Such as 'limit voltage (pull-in)', if stability is lost there."""
        lost = self.modes[0] == 0 and self.what == "limit point"
        if not lost:
            return f"{self.what} of {self.vary}"
        return f"limit {self.vary}" + (" (pull-in)" if self.vary == "voltage" else "")

    @property
    def text(self) -> str:
        """Value, place and stability."""
        before, after = self.modes
        change = "" if after is None else f"; unstable modes {before} -> {after}"
        return f"{self.value:.7g} {self.unit} at {self.displacement:.6g} mm{change}"


def critical_points(run: Run) -> list[CriticalPoint]:
    """Limit points and bifurcations of the stages that follow a branch, in order."""
    history, program = run.history, run.config.program
    if "limit_point" not in history:
        return []
    number = stages.numbers(history, program, run.info.get("stops", ()))
    titles = stages.titles(program)
    columns = {c.split("_")[0]: c for c in history.columns}
    found = []
    for k in history.index[(history["limit_point"] + history["bifurcation"]) > 0]:
        row, stage = history.loc[k], number[k]
        follow = program[stage].follow
        assert follow is not None
        name = follow.vary
        column = columns[name]
        modes = history["unstable_modes"]
        limit = bool(row["limit_point"])
        before = int(modes[k] if limit else modes[k - 1])
        goes_on = k + 1 in modes and number[k + 1] == stage
        after = (int(modes[k + 1]) if goes_on else None) if limit else int(modes[k])
        found.append(
            CriticalPoint(
                titles[stage],
                "limit point" if limit else "bifurcation",
                name,
                float(row[column]),
                column.split("_")[1],
                float(row["displacement_mm"]),
                (before, after),
            )
        )
    return found


# column of the history -> name, what it compares, and what it means to be beyond
MARGINS = {
    "breakdown_use": (
        "breakdown",
        "true field over the strength that the electrodes leave",
        "the film breaks down",
    ),
    "wrinkling_use": (
        "wrinkling",
        "lost share of the mounted tension, thickness average",
        "a real film wrinkles, this one carries pressure in its plane",
    ),
    "pull_in_use": (
        "pull-in",
        "field over the one at which the film itself loses stability",
        "a film under dead loads would be unstable; clamped as here it bears more",
    ),
    "stability_use": (
        "material stability",
        "lost share of the law's stiffness at rest",
        "the law itself is unstable",
    ),
    "stretch_use": (
        "stretch",
        "largest stretch over the one allowed",
        "the film is stretched more than is allowed",
    ),
    "locking_use": ("locking", "share of the law's extensibility", "the law has locked"),
}
VERDICTS = ("limit exceeded", "beyond")
GIVEN = ("breakdown_use", "stretch_use")  # limits of the config; the others are the film's own


@dataclass(frozen=True)
class Margin:
    """The worst of one margin over a run.

    Attributes:
        name: Of the margin.
        meaning: What is compared.
        beyond: What it means to be beyond.
        given: Whether the config gives the limit; else it is the film's own.
        use: How much is used: 1 is the limit; infinite where there is nothing left at all.
        where: Radius and height in the mesh, if known.
        when: Step, time and stage.
        ok: Whether the limit holds.
    """

    name: str
    meaning: str
    beyond: str
    given: bool
    use: float
    where: str
    when: str
    ok: bool

    @property
    def used(self) -> str:
        """`use` for the eye."""
        return f"{self.use:.3f}" if self.use < float("inf") else "∞"

    @property
    def verdict(self) -> str:
        """'ok', or one of `VERDICTS`: for a limit of the config, and for one of the film."""
        return "ok" if self.ok else VERDICTS[not self.given]


def margins(run: Run) -> list[Margin]:
    """The margins of a run, in a fixed order; of one that was killed, from its history."""
    found = run.info.get("margins") or _from_history(run)
    return [
        Margin(
            *MARGINS[column],
            column in GIVEN,
            float("inf") if m["use"] is None else m["use"],
            f"R = {m['R_mm']:.4g} mm, Z = {m['Z_mm']:.4g} mm" if "R_mm" in m else "",
            moment(run, m),
            m["ok"],
        )
        for column in MARGINS
        if (m := found.get(column)) is not None
    ]


def _from_history(run: Run) -> dict[str, dict[str, Any]]:
    try:
        h = run.history
    except ConfigError:
        return {}  # nothing has converged
    worst: dict[str, Any] = {c: h.iloc[int(h[c].argmax())].to_dict() for c in MARGINS if c in h}
    return {c: {**row, "use": row[c], "ok": row[c] <= 1 + 1e-9} for c, row in worst.items()}


def alarms(run: Run) -> dict[str, str]:
    """What is beyond a limit, by verdict: 'wrinkling 1.193, pull-in 1.072'."""
    found = [m for m in margins(run) if not m.ok]
    told = {
        verdict: ", ".join(f"{m.name} {m.used}" for m in found if m.verdict == verdict)
        for verdict in VERDICTS
    }
    return {verdict: text for verdict, text in told.items() if text}

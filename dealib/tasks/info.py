"""The summary of a run, and the report of `dealib info`."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dealib.device.records import CHAMBER, MOUNT, TURN
from dealib.errors import ConfigError, by_caller
from dealib.observe.columns import Column, columns
from dealib.results.critical import critical_points
from dealib.results.cycles import cycles
from dealib.results.reader import Run
from dealib.results.summary import actuations, alarms, margins
from dealib.units import counted, neat

if TYPE_CHECKING:
    import pandas


Loud = Callable[[str, str], str]  # emphasises a text by its verdict


def plain(verdict: str, text: str) -> str:
    """The text without emphasis."""
    return text


def summary(run: Run, loud: Loud = plain) -> str:
    """Summary of a run: ranges, actuation, critical points, steps and exceeded limits.

    Args:
        run: The run.
        loud: Emphasises a text by its verdict, such as by a colour.
    """
    h = run.history
    info = run.info
    known = [c for c in columns(run.config).values() if c.name in h]
    mounts = {v.name for kind in (MOUNT, TURN, CHAMBER) for v in kind.variables}
    rows = [(c.label, _range(h, c)) for c in known if c.quantity.label in mounts or c.probe]
    for a in actuations(run):
        kept = f" ({a.kept})" if a.kept else ""
        value = f"{neat(a.value)} {a.unit} at up to {a.peak_voltage:.4g} kV{kept}"
        rows.append((f"{a.what} in {a.stage!r}", value))
    for point in critical_points(run):
        rows.append((f"{point.name} in {point.stage!r}", point.text))
    rows += [(c.label, _range(h, c)) for c in known if c.quantity.label == "capacitance"]
    rows += [
        ("peak field", f"{h['field_max_MV_per_m'].max():.4g} MV/m"),
        (
            "steps",
            f"{len(h) - 1}, {counted(int(h['newton_iterations'].sum()), 'Newton iteration')}",
        ),
    ]
    for stop in info.get("stops", ()):
        rows.append((f"{stop['ends']} ended by", f"{stop['when']} at step {stop['step']}"))
    if "timings" in info:
        t = info["timings"]
        rows.append(("time", f"{t['total']:.2f} s, of which {t.get('solve', 0):.2f} s solving"))
    rows.append(("results", str(run.directory)))
    width = max(len(name) for name, _ in rows)
    return "\n".join([f"{name:<{width}}  {value}" for name, value in rows] + _beyond(run, loud))


def _range(history: pandas.DataFrame, column: Column) -> str:
    values = history[column.name]
    return f"{neat(values.min())} .. {neat(values.max())} {column.unit}".rstrip()


def _beyond(run: Run, loud: Loud) -> list[str]:
    """A line for each limit that is exceeded."""
    found = sorted((m for m in margins(run) if not m.ok), key=lambda m: not m.given)
    return [
        loud(m.verdict, _told(m.verdict, f"{m.name} {m.used}"))
        + f" (1 is the limit), {m.when}: {m.beyond}"
        for m in found
    ]


def _told(verdict: str, text: str) -> str:
    return f"{verdict if verdict == 'beyond' else verdict.upper()}: {text}"


def resume_command(run: Run) -> str:
    """The command that continues a run; for Python, the call."""
    info = run.info
    overrides = [part for assignment in info["set"] for part in ("--set", assignment)]
    command = "export" if "export" in info["argv"][1:2] else "run"
    words = ["dealib", command, info["config"], *overrides, "--out", str(run.directory), "--resume"]
    if info["ranks"] > 1:
        words += ["--mpi", str(info["ranks"])]
    case = repr(info["config"])
    if info["set"]:
        changes = dict(assignment.split("=", 1) for assignment in info["set"])
        case = f"dealib.load({case}, set={changes!r})"
    call = f"dealib.simulate({case}, {str(run.directory)!r}, resume=True)"
    return by_caller(shlex.join(words), call)


def describe(run: Run | str | Path, loud: Loud = plain) -> str:
    """Status, summary, versions and timings of a run directory, as text.

    Args:
        run: The run or its directory.
        loud: Emphasises a text by its verdict, such as by a colour.
    """
    run = run if isinstance(run, Run) else Run(run)
    info = run.info
    told = [loud(verdict, _told(verdict, text)) for verdict, text in alarms(run).items()]
    lines = ["; ".join([f"{run.title}: {run.status}", *told])]
    if info.get("set"):
        lines.append("changed: " + ", ".join(info["set"]))
    if "error" in info:
        lines.append(str(info["error"]))
    lines += [f"warning: {text}" for text in info.get("warnings", ())]
    try:
        _ = run.mesh, run.stored_steps
    except ConfigError as error:
        lines.append(str(error))
    if run.status in ("killed", "interrupted", "failed"):
        lines.append(f"go on with: {resume_command(run)}")
    try:
        lines += ["", summary(run, loud)]
    except ConfigError as error:
        lines.append(str(error))
    found = margins(run)
    if found:
        lines += ["", "margins (1 is the limit)"]
        lines += [
            f"  {m.name:<19} {m.used:>7} {m.verdict:<14} {m.where:<34} {m.when}" for m in found
        ]
    lines += _energy(run)
    lines += ["", "started   " + info["started"], "command   " + " ".join(info["argv"])]
    lines.append("versions  " + ", ".join(f"{k} {v}" for k, v in info["versions"].items()))
    if "timings" in info:
        lines.append("timings   " + ", ".join(f"{k} {v} s" for k, v in info["timings"].items()))
    return "\n".join(lines)


def _energy(run: Run) -> list[str]:
    """A table of the energies of closed cycles."""
    try:
        found = cycles(run)
    except ConfigError:
        return []  # the run has no converged state
    lines = []
    for c in found:
        sums = (c.electrical_in, c.electrical, c.mechanical_out, c.mechanical)
        numbers = " ".join(f"{neat(v, 4):>9}" for v in sums)
        lines.append(f"  {c.name:<44.44} {numbers} {_share(c.transfer)} {_share(c.efficiency)}")
    head = f"  {'cycle':<44} {'el. in':>9} {'el. net':>9} {'mech. out':>9} {'mech. net':>9}"
    return ["", "energy, mJ", f"{head} {'out/in':>8} {'net eff.':>8}", *lines] if lines else []


def _share(value: float) -> str:
    return f"{value:z8.3f}" if value == value else f"{'-':>8}"  # NaN differs from itself

"""What a run says about itself."""

from __future__ import annotations

import shlex

from dealib.errors import ConfigError
from dealib.results.cycles import cycles
from dealib.results.reader import Run
from dealib.results.summary import actuations, critical_points, margins


def summary(run: Run) -> str:
    """The figures that an engineer looks at first, from the history."""
    h = run.history
    info = run.info
    rows = [
        (name, f"{_clean(h[column].min()):.5g} .. {_clean(h[column].max()):.5g} {unit}")
        for name, column, unit in (
            ("displacement", "displacement_mm", "mm"),
            ("force on mount", "force_N", "N"),
        )
    ]
    for a in actuations(run):
        peak = f"at up to {a.peak_voltage:.4g} kV"
        if a.stroke is not None:
            rows.append((f"stroke in {a.stage!r}", f"{_clean(a.stroke):.5g} mm {peak}"))
        if a.force_change is not None:
            force = f"{_clean(a.force_change):.5g} N {peak} (mount held)"
            rows.append((f"force change in {a.stage!r}", force))
    for point in critical_points(run):
        rows.append((f"{point.name} in {point.stage!r}", point.text))
    c, e = h["capacitance_pF"], h["field_max_MV_per_m"]
    rows += [
        ("capacitance", f"{c.min():.5g} .. {c.max():.5g} pF"),
        ("peak field", f"{e.max():.4g} MV/m"),
        ("steps", f"{len(h) - 1}, {int(h['newton_iterations'].sum())} Newton iterations"),
    ]
    beyond = [m for m in margins(run) if not m.ok]
    for m in beyond:
        rows.append((f"beyond: {m.name}", f"{m.used} used (1 is the limit), {m.when}"))
    for stop in info.get("stops", ()):
        rows.append((f"{stop['ends']} ended by", f"{stop['when']} at step {stop['step']}"))
    if "timings" in info:
        t = info["timings"]
        rows.append(("time", f"{t['total']:.2f} s, of which {t.get('solve', 0):.2f} s solving"))
    rows.append(("results", str(run.directory)))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def _clean(value: float) -> float:
    """Without rounding errors and a minus before 0."""
    return round(float(value), 9) + 0.0


def resume_command(run: Run) -> str:
    """The command that goes on with a run."""
    info = run.info
    overrides = [part for assignment in info["set"] for part in ("--set", assignment)]
    command = "export" if "export" in info["argv"][1:2] else "run"
    words = ["dealib", command, info["config"], *overrides, "--out", str(run.directory), "--resume"]
    if info["ranks"] > 1:
        words += ["--mpi", str(info["ranks"])]
    return shlex.join(words)


def describe(run: Run) -> str:
    """Status, summary, versions and timings of a run directory."""
    info = run.info
    lines = [f"{info['name']}: {run.status}"]
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
        lines += ["", summary(run)]
    except ConfigError as error:
        lines.append(str(error))
    found = margins(run)
    if found:
        lines += ["", "margins (1 is the limit)"]
        lines += [
            f"  {m.name:<19} {m.used:>7} {'ok' if m.ok else 'BEYOND':<7} {m.where:<34} {m.when}"
            for m in found
        ]
    lines += _energy(run)
    lines += ["", "started   " + info["started"], "command   " + " ".join(info["argv"])]
    lines.append("versions  " + ", ".join(f"{k} {v}" for k, v in info["versions"].items()))
    if "timings" in info:
        lines.append("timings   " + ", ".join(f"{k} {v} s" for k, v in info["timings"].items()))
    return "\n".join(lines)


def _energy(run: Run) -> list[str]:
    """One line a closed cycle."""
    try:
        found = cycles(run)
    except ConfigError:
        return []  # nothing has converged
    lines = []
    for c in found:
        sums = (c.electrical_in, c.electrical, c.mechanical_out, c.mechanical)
        numbers = " ".join(f"{_clean(v):9.4g}" for v in sums)
        lines.append(f"  {c.name:<44.44} {numbers} {_share(c.transfer)} {_share(c.efficiency)}")
    head = f"  {'cycle':<44} {'el. in':>9} {'el. net':>9} {'mech. out':>9} {'mech. net':>9}"
    return ["", "energy, mJ", f"{head} {'out/in':>8} {'net eff.':>8}", *lines] if lines else []


def _share(value: float) -> str:
    return f"{_clean(value):8.3f}" if value == value else f"{'-':>8}"  # NaN differs from itself

"""`dealib optimise`: the best design within limits, or the front of two objectives."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import typer

from dealib.design.designs import DESIGNS, Evaluated
from dealib.design.optimise import BEST, FRONT, Optimum, beyond, optimise
from dealib.errors import NotConverged
from dealib.results import spectra
from dealib.units import counted, neat

_AT_BOUND = 1e-6  # distance from a bound, as a share of the range, at which a variable is at it


def run_optimise(path: Path, out: Path | None, model: str | None, jobs: int | None) -> None:
    """Find an optimum, draw it and print it.

    Raises:
        ConfigError: If the file is wrong.
        NotConverged: If no design is within the limits.
        Interrupted: With what is kept.
    """
    found = optimise(path, out, model, jobs, typer.echo)
    drawn = _draw(found)
    typer.echo("\n".join(["", *told(found), *map(str, drawn)]))
    if found.best is None:
        raise NotConverged(_none(found))


def told(found: Optimum) -> Iterator[str]:
    """Objectives, variables and limits of the best design; without one, of the nearest."""
    counts = f"{counted(len(found.designs), 'design')}, {found.solved} of them solved now"
    one = found.best or found.nearest
    if one is None:
        yield counts
        return
    head = "the best design" if found.best else "the nearest design, which is beyond a limit"
    if found.front:
        head = f"the knee of a front of {counted(len(found.front), 'design')}"
    yield f"{head} ({one.model}; {counts}):"
    width = max(map(len, (*found.goals.asked, *one.point, *(m.text for m in found.goals.limits))))
    for name in found.goals.asked:
        aim = next((a.sign for a in found.goals.aims if a.name == name), 0)
        note = {0: "", 1: "  (least)", -1: "  (largest)"}[aim]
        yield f"  {name:<{width}}  {neat(one.found.values[name], 6):>12}{note}"
    for name in one.point:
        yield f"  {name:<{width}}  {_value(found, one, name)}"
    for limit, by in beyond(found.goals, one):
        slack = limit.slack(one.found.values)
        note = "beyond" if by > 0 else "active" if by > -1e-3 else ""
        yield f"  {limit.text:<{width}}  slack {neat(slack, 4):>10}  {note}".rstrip()


def _value(found: Optimum, one: Evaluated, name: str) -> str:
    variable, value = found.plan.design.variables[name], one.point[name]
    if isinstance(value, str):
        return f"{value:>12}"
    low, high = variable.range
    edge = _AT_BOUND * (high - low)
    at = "at min" if value - low < edge else "at max" if high - value < edge else ""
    return f"{value:>12.6g} {variable.unit:<6}  {at}".rstrip()


def _none(found: Optimum) -> str:
    """The message if there is no best design."""
    if found.nearest is None:
        errors = {str(row["error"]).splitlines()[0] for row in found.designs if row["error"]}
        return f"{found.plan.path}: no design converges: {'; '.join(sorted(errors)[:3])}"
    by = [(part, limit) for limit, part in beyond(found.goals, found.nearest) if part > 0]
    missed = ", ".join(
        f"{limit.text!r} is missed by {part:.2%}" for part, limit in sorted(by, key=lambda x: x[0])
    )
    return f"{found.plan.path}: no design is within all limits; in the nearest one, {missed}"


def _draw(found: Optimum) -> list[Path]:
    """Draw the pictures; returns all files of the results."""
    from dealib.plots import design, style

    folder, title = found.directory, found.plan.design.description or found.plan.name
    files = [folder / DESIGNS]
    table = spectra.read(files[0])
    with style.theme() as look:
        way = design.draw_way(table, [(a.name, a.sign) for a in found.goals.aims], title, look)
        style.save(way, files[0].with_suffix(".png"))
        files.append(files[0].with_suffix(".png"))
        if found.front:
            files += [folder / FRONT, (folder / FRONT).with_suffix(".png")]
            first, second = (aim.name for aim in found.goals.aims)
            front = spectra.read(files[2])
            drawn = design.draw_front(table, front, (first, second), title, look)
            style.save(drawn, files[3])
    return [*files, folder / BEST] if found.best else files

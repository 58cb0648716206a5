"""`dealib plot`: curves, contours, profiles and the revolved view of runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dealib.errors import ConfigError, PlatformError
from dealib.results.reader import Run


def plot(
    runs: Sequence[Path],
    x: str | None,
    ys: Sequence[str],
    field: str | None,
    profiles: Sequence[str],
    revolved: bool,
    step: int | None,
    out: Path | None,
    dark: bool,
    overwrite: bool,
) -> Path:
    """Draw what was asked for and return the file.

    Raises:
        ConfigError: If the options contradict each other, or name nothing that is there.
    """
    found = [Run(path) for path in runs]
    of_step = {
        "--field": field is not None and not revolved,
        "--profile": bool(profiles),
        "--revolved": revolved,
    }
    kinds = [name for name, given in of_step.items() if given]
    if len(kinds) > 1 or (kinds and (x is not None or ys)) or (profiles and field is not None):
        raise ConfigError(
            "give one of: -x and -y (curves), --field, --profile, --revolved (with --field)"
        )
    if kinds and len(found) > 1:
        raise ConfigError(f"{kinds[0]} draws one run, not {len(found)}")
    if step is not None and not kinds:
        raise ConfigError("--step belongs to --field, --profile or --revolved")
    if x is not None and not ys:
        raise ConfigError(f"-x {x}: say with -y what to draw against it")
    from dealib.plots import style

    if out is not None:
        style.check_target(out, style.FORMATS, overwrite)
    with style.theme(dark) as look:
        figure, name = _figure(found, x, ys, field, profiles, revolved, step, look)
        target = out or default(found, name, dark)
        style.save(figure, target)
    return target


def _figure(
    runs: list[Run],
    x: str | None,
    ys: Sequence[str],
    field: str | None,
    profiles: Sequence[str],
    revolved: bool,
    step: int | None,
    look: Any,
) -> tuple[Any, str]:
    """The figure and the name of its file."""
    if field is not None or profiles or revolved:
        from dealib.plots.shape import Shape, step_of
        from dealib.results import quantities

        what = quantities.quantity(field or "E", runs[0].config.device.kinematics)
        step = step_of(runs[0], what) if step is None else step
        shape = Shape(runs[0], step, mode=what.field if what.is_mode else "")
        if profiles:
            from dealib.plots.profiles import draw_profiles

            charge = (quantities.SURFACE_CHARGE,)
            space = shape.kinematics
            chosen = [quantities.quantity(name, space, "profile", charge) for name in profiles]
            name = "+".join(q.name for q in chosen)
            return draw_profiles(shape, chosen), f"profile-{name}-step{shape.step:05d}"
        from dealib.plots.views import draw_field, draw_revolved

        draw, kind = (draw_revolved, "revolved") if revolved else (draw_field, "field")
        return draw(shape, what, look), f"{kind}-{what.name}-step{shape.step:05d}"
    from dealib.plots.curves import clock_of, curves, overview

    if not ys:
        return overview(runs), "overview"
    return curves(runs, x, ys), f"{'+'.join(ys)}-over-{x or clock_of(runs)}"


def default(runs: Sequence[Run], name: str, dark: bool = False, suffix: str = ".png") -> Path:
    """Where pictures go: `plots/` of the (first) run; this folder is dealib's own."""
    folder = runs[0].directory / "plots"
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {folder}: {error.strerror}") from None
    others = "".join(f"-vs-{run.directory.resolve().name}" for run in runs[1:])
    return folder / f"{name}{others}{'-dark' if dark else ''}{suffix}"

"""Pictures, movies and pages of runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.errors import ConfigError, PlatformError, by_caller
from dealib.files import write_text
from dealib.results.reader import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dealib.config.case import Case

Given = Run | str | Path
_PERIOD = 2.0  # period of a mode in its movie, s
_RATES = {".mp4": 20, ".gif": 10}  # frames per second


def as_run(run: Given) -> Run:
    """The run itself, or the run of a directory."""
    return run if isinstance(run, Run) else Run(run)


def as_runs(runs: Given | Sequence[Given]) -> list[Run]:
    """A list of runs, from one or several runs or directories."""
    return [as_run(r) for r in ([runs] if isinstance(runs, (Run, str, Path)) else runs)]


def plot(
    runs: Given | Sequence[Given],
    x: str | None = None,
    y: str | Sequence[str] = (),
    *,
    field: str | None = None,
    profile: str | Sequence[str] = (),
    revolved: bool = False,
    step: int | None = None,
    out: str | Path | None = None,
    dark: bool = False,
    overwrite: bool = False,
) -> Figure:
    """Draw one or several runs: an overview, columns of the history, a field, or profiles.

    Args:
        runs: Runs or their directories.
        x: Column to draw against; default time.
        y: Columns; default an overview.
        field: A field on the deformed device, such as 'E' or 'S_RR'.
        profile: Fields along a layer.
        revolved: The body of revolution in 3-D, coloured by `field`.
        step: Number of the step; default that of the largest voltage.
        out: File: .png, .svg or .pdf.
        dark: On a dark background.
        overwrite: Replace the file.

    Returns:
        The Matplotlib figure, which a notebook shows.

    Raises:
        ConfigError: If the arguments contradict each other, or a column or field is unknown.
    """
    from dealib.plots import style

    if out is not None:
        style.check_target(Path(out), style.FORMATS, overwrite)
    with drawn(as_runs(runs), x, y, field, profile, revolved, step, dark) as (figure, _):
        figure.canvas.draw()  # while the theme lasts
        if out is not None:
            style.save(figure, Path(out))
        return figure


@contextmanager
def drawn(
    runs: list[Run],
    x: str | None,
    y: str | Sequence[str],
    field: str | None,
    profile: str | Sequence[str],
    revolved: bool,
    step: int | None,
    dark: bool,
) -> Iterator[tuple[Figure, str]]:
    """A figure and the stem of its file's name; its theme lasts as long as the context.

    Arguments and errors are those of `plot`.
    """
    ys, profiles = ([t] if isinstance(t, str) else list(t) for t in (y, profile))
    named = {n: by_caller(f"--{n}", n) for n in ("field", "profile", "revolved", "step")}
    named |= {n: by_caller(f"-{n}", n) for n in ("x", "y")}
    of_step = {
        named["field"]: field is not None and not revolved,
        named["profile"]: bool(profiles),
        named["revolved"]: revolved,
    }
    kinds = [name for name, given in of_step.items() if given]
    if len(kinds) > 1 or (kinds and (x is not None or ys)) or (profiles and field is not None):
        raise ConfigError(
            "give one of: {x} and {y} (curves), {field}, {profile}, "
            "{revolved} (with {field})".format_map(named)
        )
    if kinds and len(runs) > 1:
        raise ConfigError(f"{kinds[0]} draws one run, not {len(runs)}")
    if step is not None and not kinds:
        raise ConfigError("{step} belongs to {field}, {profile} or {revolved}".format_map(named))
    if x is not None and not ys:
        with_y = by_caller("give -y, the columns", "give y, the columns")
        raise ConfigError(f"{named['x']} {x}: {with_y} to draw against it")
    from dealib.plots import style

    with style.theme(dark) as look:
        yield _figure(runs, x, ys, field, profiles, revolved, step, look)


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
    """The figure and the stem of its file's name."""
    if field is not None or profiles or revolved:
        from dealib.plots.shape import LayerShape, step_of
        from dealib.results import quantities

        what = quantities.quantity(field or "E", runs[0].config.device.kinematics)
        step = step_of(runs[0], what) if step is None else step
        shape = LayerShape(runs[0], step, mode=what.field if what.is_mode else "")
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
    """Default path of a picture: in `plots` of the first run, which is created.

    Args:
        runs: The runs in the picture.
        name: Stem of its name.
        dark: Whether it is on a dark background.
        suffix: Suffix of its name.

    Raises:
        PlatformError: If the folder cannot be created.
    """
    folder = runs[0].directory / "plots"
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {folder}: {error.strerror}") from None
    others = "".join(f"-vs-{run.directory.resolve().name}" for run in runs[1:])
    return folder / f"{name}{others}{'-dark' if dark else ''}{suffix}"


def animate(
    run: Given,
    field: str | Sequence[str] = (),
    out: str | Path | None = None,
    *,
    seconds: float = 8.0,
    dark: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write a movie of the deforming device beside its input curves.

    Args:
        run: The run or its directory.
        field: Fields that colour the device, in a picture each; by default chosen for the run.
        out: .mp4 or .gif; default a name in `plots` of the run.
        seconds: Length of the movie, s.
        dark: On a dark background.
        overwrite: Replace `out`.

    Returns:
        The file.

    Raises:
        ConfigError: If a field is unknown, the suffix is another one, the file exists already, or
            too few steps are stored.
    """
    run = as_run(run)
    from dealib.plots import animation, modes, style
    from dealib.plots.shape import step_of
    from dealib.results.quantities import quantity

    names = [field] if isinstance(field, str) else list(field)
    space = run.config.device.kinematics
    whats = [quantity(name, space) for name in names] or animation.usual(run)
    if out is not None:
        style.check_target(Path(out), animation.FORMATS, overwrite)
    usual = f"animation-{'+'.join(w.name for w in whats)}"
    target = Path(out) if out is not None else default([run], usual, dark, ".mp4")
    rate = _RATES[target.suffix.lower()]
    with style.theme(dark) as look:
        count = max(2, round(rate * seconds))
        if any(w.is_mode for w in whats):
            fields, periods = [w.field for w in whats], max(1, round(seconds / _PERIOD))
            images = modes.frames(run, step_of(run, whats[0]), look, fields, count, periods)
        else:
            images = animation.frames(run, whats, look, count)
        animation.write(images, target, rate)
    return target


def write_report(run: Given, out: str | Path | None = None, *, overwrite: bool = False) -> Path:
    """Write one self-contained HTML page about a run: device, pictures, curves, margins.

    Args:
        run: The run or its directory.
        out: The file; default `report.html` of the run, which is replaced.
        overwrite: Replace `out`.

    Returns:
        The file.

    Raises:
        ConfigError: If there is no run or no converged state, or the file exists already.
    """
    run = as_run(run)
    if out is not None:
        from dealib.plots.style import check_target

        check_target(Path(out), (".html",), overwrite)
    from dealib.report.page import render

    target = Path(out) if out is not None else run.directory / "report.html"
    write_text(target, render(run))
    return target


def show(
    what: Run | Case, keys: Sequence[str] = (), *, port: int = 0, browser: bool = True
) -> None:
    """Show a run in the browser, or a case with sliders for its numbers, until Ctrl-C.

    Args:
        what: The run or the case.
        keys: Numbers or sections of the case that get sliders; default the main ones.
        port: Port of 127.0.0.1; 0: a free one.
        browser: Open the page in the browser.

    Raises:
        ConfigError: If the case has no such key, or the port is taken.
        PlatformError: If dash is not installed.
    """
    from dealib.app import page

    if isinstance(what, Run):
        page.view(what, port, browser)
    else:
        page.show(what, list(keys), port, browser)

"""`dealib animate`: a film of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dealib.cli.plot import default
from dealib.results.reader import Run

_PERIOD = 2.0  # s, of a mode
_RATES = {".mp4": 20, ".gif": 10}  # pictures a second


def animate(
    directory: Path,
    fields: Sequence[str],
    out: Path | None,
    seconds: float,
    dark: bool,
    overwrite: bool,
) -> Path:
    """Write the film and return its file.

    Raises:
        ConfigError: If the field or the file name will not do, or too few steps are stored.
    """
    run = Run(directory)
    from dealib.plots import animation, modes, style
    from dealib.plots.shape import step_of
    from dealib.results.quantities import quantity

    whats = [quantity(name, run.config.device.kinematics) for name in fields] or animation.usual(
        run
    )
    if out is not None:
        style.check_target(out, animation.FORMATS, overwrite)
    target = out or default([run], f"animation-{'+'.join(w.name for w in whats)}", dark, ".mp4")
    rate = _RATES[target.suffix.lower()]
    with style.theme(dark) as look:
        count = max(2, round(rate * seconds))
        if any(w.is_mode for w in whats):
            names, periods = [w.field for w in whats], max(1, round(seconds / _PERIOD))
            images = modes.frames(run, step_of(run, whats[0]), look, names, count, periods)
        else:
            images = animation.frames(run, whats, look, count)
        animation.write(images, target, rate)
    return target

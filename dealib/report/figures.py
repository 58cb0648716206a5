"""The pictures of a report, each in a light and a dark version, as data URIs."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from dealib.errors import ConfigError, PlatformError
from dealib.observe.columns import columns
from dealib.plots import style
from dealib.plots.curves import curves, overview
from dealib.plots.labels import label, plain, split
from dealib.plots.limits import uses
from dealib.plots.mesh import draw_mesh
from dealib.plots.profiles import draw_profiles
from dealib.plots.shape import LayerShape, step_of, typical_step
from dealib.plots.style import Theme, save, theme
from dealib.plots.views import draw_field
from dealib.results.quantities import SURFACE_CHARGE, FieldQuantity, main_stress, quantity
from dealib.results.reader import Run
from dealib.results.section import RunSection
from dealib.results.summary import stored_note, under_voltage

_MIME = {"svg": "image/svg+xml", "png": "image/png"}


@dataclass(frozen=True)
class Picture:
    """A picture in both themes, as data URIs."""

    light: str
    dark: str


def both(draw: Callable[[Theme], Any], kind: str) -> Picture:
    """Draw a figure in both themes.

    Args:
        draw: Function that draws a figure in a theme.
        kind: 'svg' or 'png'.
    """
    found: list[bytes] = []
    for dark in (False, True):
        if dark and kind == "svg":
            found.append(style.darkened(found[0].decode()).encode())
            continue
        with theme(dark) as look:
            data = io.BytesIO()
            save(draw(look), data, kind, dpi=110)
            found.append(data.getvalue())
    texts = (base64.b64encode(data).decode("ascii") for data in found)
    return Picture(*(f"data:{_MIME[kind]};base64,{text}" for text in texts))


def pictures(run: Run) -> tuple[dict[str, Picture], list[str]]:
    """The pictures of a run by name, and messages about those that cannot be drawn."""
    energies = [name for name in columns(run.config) if split(name)[1] == "mJ"]
    energies = [name for name in energies if name in run.history]
    found = {
        "overview": both(lambda look: overview([run]), "svg"),
        "energy": both(lambda look: curves([run], None, energies), "svg"),
        "margins": both(lambda look: uses(run), "svg"),
    }
    if len(run.history) > 1:
        found["iterations"] = both(lambda look: _iterations(run), "svg")
    lost = []
    for draw in (_fields, _wrinkles, _mesh):
        try:
            found |= draw(run)
        except (ConfigError, PlatformError) as error:
            lost.append(f"{error}; its pictures are left out.")
    return found, lost


def shown(run: Run) -> list[FieldQuantity]:
    """Fields of the report: the electric field, and the stresses along and across the layers."""
    device, section = run.config.device, RunSection(run)
    names = [main_stress(device), f"S_{2 * device.kinematics.axes[section.across]}"]
    return [quantity(name, device.kinematics) for name in dict.fromkeys(["E", *names])]


def turned(run: Run) -> list[FieldQuantity]:
    """Fields of the interactive view; the first one is shown at first."""
    charged = bool(under_voltage(run.history).any()) and not stored_note(run)
    field, *stresses = shown(run)
    crests, u = (quantity(name, run.config.device.kinematics) for name in ("wrinkling", "u"))
    wrinkled = run.config.physics.wrinkling == "tension_field"
    return [field] * charged + [crests] * wrinkled + [*stresses, u]


def _fields(run: Run) -> dict[str, Picture]:
    """Fields at the largest voltage."""
    if not run.stored_steps:
        return {}
    shape = LayerShape(run, typical_step(run))
    charged = bool(under_voltage(run.history)[run.history["step"] == shape.step].all())
    whats = shown(run)[not charged :]
    found = {what.name: both(partial(draw_field, shape, what), "png") for what in whats}
    mode = quantity("mode", shape.kinematics)
    bent = LayerShape(run, step_of(run, mode), mode=mode.field)
    if mode.field in bent.arrays:
        found[mode.name] = both(partial(draw_field, bent, mode), "png")
    if shape.core is None:
        return found
    lines = [SURFACE_CHARGE, whats[charged]][not charged :]
    return found | {"profiles": both(lambda look: draw_profiles(shape, lines), "svg")}


def _wrinkles(run: Run) -> dict[str, Picture]:
    """Wrinkles of a tension field, at the step at which the electric field is drawn."""
    if run.config.physics.wrinkling != "tension_field" or not run.stored_steps:
        return {}
    shape = LayerShape(run, typical_step(run))
    what = quantity("wrinkling", shape.kinematics)
    return {"wrinkling": both(partial(draw_field, shape, what), "png")}


def _mesh(run: Run) -> dict[str, Picture]:
    path = run.directory / "mesh.msh"
    if not path.is_file():
        return {}
    return {"mesh": both(lambda look: draw_mesh(path, run.config), "png")}


def _iterations(run: Run) -> Any:
    """Newton iterations by step."""
    h = run.history[1:]
    figure, axis = style.plt.subplots(figsize=(7, 2.4), layout="constrained")
    for k, (stage, part) in enumerate(h.groupby("stage", sort=False)):
        axis.bar(part["step"], part["newton_iterations"], color=f"C{k % 6}", label=plain(stage))
    axis.set(xlabel="Step", ylabel=label("newton_iterations"))
    axis.yaxis.set_major_locator(style.plt.MaxNLocator(integer=True))
    axis.grid(False, axis="x")
    figure.legend(loc="outside upper center", ncols=6)
    return figure

"""The tables of a run's report: names, values and units as text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from pydantic import BaseModel

from dealib.config.program import Stage
from dealib.config.schema import Config
from dealib.errors import ConfigError
from dealib.results.cycles import cycles
from dealib.results.reader import Run
from dealib.results.summary import actuations, critical_points, moment, stored_note
from dealib.units import neat, write

Rows = list[tuple[str, str]]

_QUANTITY = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?) (\S+)")


def text(value: Any) -> str:
    """A value of the config for the eye: '0.03 mm' is '30 µm'."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", "−")
    if isinstance(value, (list, tuple)):
        parts = [text(v) for v in value]
        units = {p.partition(" ")[2] for p in parts}
        if len(units) == 1 and all(" " in p for p in parts):
            return " → ".join(p.partition(" ")[0] for p in parts) + f" {units.pop()}"
        return ", ".join(parts)
    if isinstance(value, Mapping):
        return ", ".join(f"{_words(k)} {text(v)}" for k, v in value.items())
    found = _QUANTITY.fullmatch(str(value))
    if found is None:
        return str(value)
    number, unit = float(found[1]), found[2]
    if unit == "mm" and 0 < abs(number) < 0.1:
        number, unit = 1e3 * number, "µm"
    return f"{number:.6g} {unit.replace('uC', 'µC')}".replace("-", "−")


def rows(section: BaseModel) -> Rows:
    """Name and value of what a section of the config says."""
    given = section.model_dump(exclude_none=True)
    given = {k: given[k] for k in sorted(given, key=lambda k: k != "law")}  # the law comes first
    return [(_words(k), text(v)) for k, v in given.items() if v != ()]


def _words(key: str) -> str:
    return key.replace("_", " ").replace("youngs", "Young's")


def device(config: Config) -> dict[str, Rows]:
    """What was solved, by section."""
    found = {
        "Geometry": rows(config.geometry),
        "Film": rows(config.materials.film),
    }
    if config.materials.electrode is not None and config.geometry.electrode_thickness > 0:
        found["Electrodes"] = rows(config.materials.electrode)
    found["Physics"] = rows(config.physics)
    found["Mesh"] = rows(config.mesh)
    return found


def program(config: Config) -> list[dict[str, str]]:
    """The load program, one row a stage."""
    return [
        {
            "stage": stage.stage,
            "duration": text(write(stage.duration, "time")) if _timed(stage) else "",
            "steps": str(stage.steps) + (f" × {stage.cycles}" if stage.cycles > 1 else ""),
            "mount": "the film is stretched"
            if stage.stage == "prestrain"
            else _port("mount", stage),
            "terminal": _port("terminal", stage),
        }
        for stage in config.program
    ]


def _timed(stage: Stage) -> bool:
    """Whether its duration is time: neither of the pre-strain nor of a path."""
    return stage.stage != "prestrain" and stage.follow is None


def _port(port: str, stage: Stage) -> str:
    """What a stage does at the mount or at the terminal."""
    if stage.follow is not None and PORT_OF[stage.follow.vary] == port:
        until = stage.follow.until.model_dump(exclude_none=True)
        return f"{stage.follow.vary} followed until {text(until)}"
    given = getattr(stage, port)
    if given is None:
        return "unchanged"
    ((name, value),) = given.model_dump(exclude_none=True).items()
    return f"{name} {text(value)}"


def headline(run: Run) -> list[tuple[str, str]]:
    """The figures that matter most, value first."""
    h = run.history
    u, c = h["displacement_mm"], h["capacitance_pF"]
    found = [(f"{_number(u.min(), 4)}…{_number(u.max(), 4)} mm", "displacement")]
    for a in actuations(run):
        if a.stroke is not None:
            found.append((f"{_number(a.stroke)} mm", f"stroke in “{a.stage}”"))
        if a.force_change is not None:
            found.append((f"{_number(a.force_change)} N", f"force change in “{a.stage}”"))
    for point in critical_points(run):
        found.append((f"{_number(point.value)} {point.unit}", f"{point.name} in “{point.stage}”"))
    found.append((f"{c.min():.4g}…{c.max():.4g} pF", "capacitance"))
    found.append((f"{h['field_max_MV_per_m'].max():.4g} MV/m", "peak field"))
    found.append((f"{h['thickness_stretch_min'].min():.4f}", "smallest thickness stretch"))
    return found


def margins(run: Run) -> list[tuple[str, str, str]]:
    """Extreme values that decide whether a device lives, and when they occur."""
    h = run.history
    found = []
    for name, column, unit, largest in (
        ("Largest true field in the film", "field_max_MV_per_m", "MV/m", True),
        ("Smallest thickness stretch of the film", "thickness_stretch_min", "", False),
        ("Largest stretch of the film", "stretch_max", "", True),
        ("Largest voltage", "voltage_kV", "kV", True),
    ):
        if column not in h:
            continue
        k = int(h[column].abs().argmax() if largest else h[column].argmin())
        row = h.iloc[k]
        found.append((name, f"{_number(float(row[column]))} {unit}".strip(), moment(run, row)))
    return found


def energy(run: Run) -> Rows:
    """The balance of work and stored energy over the whole run."""
    h = run.history
    stored = h["elastic_energy_mJ"] + h["electric_energy_mJ"]
    residual = h["energy_residual_mJ"].abs().max()
    lost = [("Dissipated in Maxwell branches", h.get("dissipated_energy_mJ"))]
    return [
        ("Work done at the mount", f"{_number(h['mount_work_mJ'].iloc[-1])} mJ"),
        ("Work done at the terminal", f"{_number(h['terminal_work_mJ'].iloc[-1])} mJ"),
        (
            "Stored: change of elastic and electric energy",
            f"{_number(stored.iloc[-1] - stored[0])} mJ",
        ),
        *((name, f"{_number(x.iloc[-1])} mJ") for name, x in lost if x is not None),
        ("Largest residual of the balance", f"{_number(residual)} mJ: {_share_told(run)}"),
    ]


def cycle_table(run: Run) -> list[tuple[str, ...]]:
    """Work and efficiency of each closed cycle."""
    return [
        (
            c.name,
            *(_number(v) for v in (c.electrical_in, c.electrical, c.mechanical_out, c.mechanical)),
            *("–" if np.isnan(v) else f"{100 * v:.3g} %" for v in (c.transfer, c.efficiency)),
        )
        for c in cycles(run)
    ]


def share(run: Run) -> float:
    """Largest residual of the energy balance, in % of the largest energy exchanged."""
    largest = max(_exchanged(run).values())
    residual = float(run.history["energy_residual_mJ"].abs().max())
    return 100 * residual / largest if largest > 0 else 0.0


def _exchanged(run: Run) -> dict[str, float]:
    """Largest absolute values of the work of both ports and of the change of stored energy, mJ."""
    h = run.history
    stored = h["elastic_energy_mJ"] + h["electric_energy_mJ"]
    parts = {
        "work at the mount": h["mount_work_mJ"],
        "work at the terminal": h["terminal_work_mJ"],
        "change of stored energy": stored - stored[0],
    }
    return {name: float(part.abs().max()) for name, part in parts.items()}


def _share_told(run: Run) -> str:
    exchanged = _exchanged(run)
    most = max(exchanged, key=exchanged.__getitem__)
    return f"{share(run):.2g} % of the largest {most}, {_number(exchanged[most])} mJ"


def solution(run: Run) -> Rows:
    """Unknowns, iterations and increments cut."""
    h, info = run.history, run.info
    program, taken = run.config.program, len(h) - 1
    planned = sum(s.steps * s.cycles for s in program if s.stage != "prestrain")
    iterations = h["newton_iterations"][1:]
    found = [("Unknowns", f"{info['unknowns']:,}".replace(",", " "))] if "unknowns" in info else []
    if any(s.follow is not None for s in program):
        found.append(("Steps", f"{taken}; a branch takes as many as it turns out to need"))
    else:
        found.append(("Steps", f"{taken} of {planned} planned"))
        found.append(("Further steps: increments cut, corners of inputs", str(_further(run))))
    if taken:
        found.append(
            (
                "Newton iterations",
                f"{iterations.sum()} in all, {iterations.mean():.1f} a step, "
                f"at most {iterations.max()}",
            )
        )
    found.append(("MPI ranks", str(info.get("ranks", 1))))
    return found


def _further(run: Run) -> int:
    """Steps beyond the planned ones of the stages that were reached."""
    stages: list[Stage] = [s for s in run.config.program if s.stage != "prestrain"]
    taken = run.history["stage"][1:].value_counts()
    planned: dict[str, int] = {}
    for s in stages:
        planned[s.stage] = planned.get(s.stage, 0) + s.steps * s.cycles
    return int(sum(max(0, int(n) - planned.get(str(stage), 0)) for stage, n in taken.items()))


def warnings(run: Run) -> list[str]:
    """What a reader must know before trusting the page."""
    info = run.info
    found = [str(w) for w in info.get("warnings", [])]
    if info["status"] != "done":
        found.insert(
            0, f"The run is not complete: {info['status']}. {info.get('error', '')}".strip()
        )
    for stop in info.get("stops", []):
        found.append(
            f"The {stop['ends']} was ended by its condition {stop['when']} at step {stop['step']}."
        )
    if share(run) > 1:
        found.append(
            f"The energy balance closes to {_share_told(run)} only: the trapezoidal rule between "
            "the steps is coarse; more steps make it smaller."
        )
    with suppress(ConfigError):  # damaged states: where their pictures are drawn, it is told
        if not run.stored_steps:
            found.append("No fields are stored (output.fields: none), so there are no pictures.")
        elif told := stored_note(run):
            found.append(f"{told.capitalize()}, so there is no picture of the electric field.")
    return found


def _number(value: float, digits: int = 5) -> str:
    return neat(value, digits).replace("-", "−")

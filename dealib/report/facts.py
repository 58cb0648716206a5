"""The tables of a run's report: names, values and units as text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from dealib.config.program import Stage
from dealib.config.schema import Config
from dealib.device.laminate import Laminate
from dealib.device.records import TERMINAL, Port
from dealib.device.shapes import LaminateShape
from dealib.errors import ConfigError
from dealib.observe.columns import Column, columns
from dealib.results.critical import critical_points
from dealib.results.cycles import cycles
from dealib.results.reader import Run
from dealib.results.summary import actuations, moment, motion, stored_note, voltages
from dealib.units import neat, write

if TYPE_CHECKING:
    import pandas

Rows = list[tuple[str, str]]
_MOST_LAYERS = 6  # that are told one by one

_QUANTITY = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?) (\S+)")


_SMALLER = {"mm": "µm", "MPa": "kPa"}


def text(value: Any) -> str:
    """A value of the config as text for the page: '0.03 mm' becomes '30 µm'."""
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
    if unit in _SMALLER and 0 < abs(number) < 0.1:
        number, unit = 1e3 * number, _SMALLER[unit]
    return f"{number:.6g} {unit.replace('uC', 'µC')}".replace("-", "−")


def rows(section: BaseModel) -> Rows:
    """Names and values of the keys in a section of the config."""
    given = section.model_dump(exclude_none=True)
    given = {k: given[k] for k in sorted(given, key=lambda k: k != "law")}  # the law comes first
    return [(_words(k), text(v)) for k, v in given.items() if v != ()]


def _words(key: str) -> str:
    return key.replace("_", " ").replace("youngs", "Young's")


def device(config: Config) -> dict[str, Rows]:
    """What was solved, by section."""
    given, laminate = config.geometry, config.device.laminate
    found = {"Geometry": rows(given)}
    if isinstance(given, LaminateShape) and laminate is not None:
        known = [(name, value) for name, value in found["Geometry"] if name != "layers"]
        found["Geometry"] = known + _layers(laminate)
    for name, material in config.solids.items():
        found[_words(name).capitalize()] = rows(material)
    for port in config.device.ports:
        along = f", along {port.along}" if port.along else ""
        told = f"on {', '.join(port.on)}{along}" + (", floating" if port.floating else "")
        found.setdefault("Ports", []).append((_title(port), told))
    if config.regions:
        found["Geometry"].append(("regions", text(config.regions)))
    mesh = [("order", str(config.mesh.order))] if laminate is None else rows(config.mesh)
    return found | {"Physics": rows(config.physics), "Mesh": mesh}


def _layers(laminate: Laminate) -> Rows:
    """The layers from the lowest up; if there are many, equal ones are counted."""
    told = [
        f"{layer.material}, {text(write(layer.thickness, 'length'))}"
        + (", on a part of the base" if layer.within is not None else "")
        for layer in laminate.layers
    ]
    if len(told) <= _MOST_LAYERS:
        names = (f"layer {layer.name}" for layer in laminate.layers)
        return list(zip(names, told, strict=True))
    return [("layers", f"{len(told)}")] + [(f"{n} of them", of) for of, n in Counter(told).items()]


def _title(port: Port) -> str:
    return port.kind.name if port.name == port.kind.name else f"{port.kind.name} {port.name}"


def program(config: Config) -> list[dict[str, str]]:
    """The load program, one row a stage."""
    return [
        {
            "stage": stage.stage,
            "duration": text(write(stage.duration, "time")) if _timed(stage) else "",
            "steps": _steps(stage) + (f" × {stage.cycles}" if stage.cycles > 1 else ""),
            "inputs": _inputs(stage),
        }
        for stage in config.program
    ]


def _steps(stage: Stage) -> str:
    return f"auto, {stage.count} rows" if stage.auto else str(stage.steps)


def _timed(stage: Stage) -> bool:
    """Whether the stage has a duration: neither the pre-strain nor a followed branch has one."""
    return stage.stage != "prestrain" and stage.follow is None


def _inputs(stage: Stage) -> str:
    """What a stage changes at the ports."""
    if stage.stage == "prestrain":
        return "the film is stretched"
    found = []
    for _, kind, name, given in stage.inputs:
        ((what, value),) = given.model_dump(exclude_none=True).items()
        port = kind.name if name in (None, kind.name) else f"{kind.name} {name}"
        found.append(f"{port}: {_words(what)} {text(value)}")
    if stage.follow is not None:
        until = text(stage.follow.model_dump()["until"])
        found.append(f"{stage.follow.vary} followed until {until}")
    return "; ".join(found) or "unchanged"


def headline(run: Run) -> list[tuple[str, str]]:
    """The most important figures, as (value, name)."""
    h, known = run.history, columns(run.config)
    there = [c for c in known.values() if c.name in h]
    moves = [*motion(run)[:1], *(c.name for c in there if c.probe)]
    found = [_range(h, known[name]) for name in dict.fromkeys(moves)]
    for a in actuations(run):
        found.append((f"{_number(a.value)} {a.unit}".rstrip(), f"{a.what} in “{a.stage}”"))
    for point in critical_points(run):
        found.append((f"{_number(point.value)} {point.unit}", f"{point.name} in “{point.stage}”"))
    own = [c for c in there if c.quantity.pairs and len(set(c.ports)) == 1]
    found += [_range(h, column) for column in own]
    found.append((f"{h['field_max_MV_per_m'].max():.4g} MV/m", "peak field"))
    found.append((f"{h['thickness_stretch_min'].min():.4f}", "smallest thickness stretch"))
    return [(value.replace("mm3", "mm³"), name) for value, name in found]


def _range(history: Any, column: Column) -> tuple[str, str]:
    low, high = (_number(f(history[column.name]), 4) for f in (min, max))
    return f"{low}…{high} {column.unit}".rstrip(), column.label


def margins(run: Run) -> list[tuple[str, str, str]]:
    """Extreme values of field, stretch and voltage, and when they occur."""
    h = run.history
    found = []
    for name, values, unit, largest in (
        ("Largest true field in the film", h["field_max_MV_per_m"], "MV/m", True),
        ("Smallest thickness stretch of the film", h["thickness_stretch_min"], "", False),
        ("Largest stretch of the film", h.get("stretch_max"), "", True),
        ("Largest voltage", voltages(h) if run.config.device.of(TERMINAL) else None, "kV", True),
    ):
        if values is None:
            continue
        k = int(values.argmax() if largest else values.argmin())
        found.append((name, f"{_number(float(values[k]))} {unit}".strip(), moment(run, h.iloc[k])))
    return found


def energy(run: Run) -> Rows:
    """The balance of work and stored energy over the whole run."""
    h, exchanged = run.history, _exchanged(run)
    residual = h["energy_residual_mJ"].abs().max()
    found = [
        (f"{name[0].upper()}{name[1:]}", f"{_number(part.iloc[-1])} mJ")
        for name, part in exchanged.items()
    ]
    if "dissipated_energy_mJ" in h:
        lost = h["dissipated_energy_mJ"].iloc[-1]
        found.append(("Dissipated in the materials", f"{_number(lost)} mJ"))
    told = f"{_number(residual)} mJ: {_share_told(run)}"
    return [*found, ("Largest residual of the balance", told)]


def cycle_table(run: Run) -> list[tuple[str, ...]]:
    """Work and efficiency of each closed cycle."""
    return [
        (
            c.name,
            *(_number(v) for v in (c.electrical_in, c.electrical, c.mechanical_out, c.mechanical)),
            *(
                "–" if np.isnan(v) else f"{round(100 * v, 6):.3g} %"
                for v in (c.transfer, c.efficiency)
            ),
        )
        for c in cycles(run)
    ]


def share(run: Run) -> float:
    """Largest residual of the energy balance, in % of the largest energy exchanged."""
    largest = max(float(part.abs().max()) for part in _exchanged(run).values())
    residual = float(run.history["energy_residual_mJ"].abs().max())
    return 100 * residual / largest if largest > 0 else 0.0


def _exchanged(run: Run) -> dict[str, pandas.Series[float]]:
    """Work of each port and change of stored energy, mJ, row by row."""
    h = run.history
    stored = h["elastic_energy_mJ"] + h["electric_energy_mJ"]
    parts = {
        f"work done at the {_title(port)}": h[port.named(f"{port.kind.name}_work_mJ")]
        for port in run.config.device.ports
    }
    return parts | {"change of stored energy": stored - stored[0]}


def _share_told(run: Run) -> str:
    exchanged = {name: float(part.abs().max()) for name, part in _exchanged(run).items()}
    most = max(exchanged, key=exchanged.__getitem__)
    return f"{share(run):.2g} % of the largest {most}, {_number(exchanged[most])} mJ"


def solution(run: Run) -> Rows:
    """Numbers of unknowns, steps and iterations."""
    h, info = run.history, run.info
    program, taken = run.config.program, len(h) - 1
    planned = sum(s.count * s.cycles for s in program if s.stage != "prestrain")
    iterations = h["newton_iterations"][1:]
    found = [("Unknowns", f"{info['unknowns']:,}".replace(",", " "))] if "unknowns" in info else []
    if any(s.follow is not None for s in program):
        found.append(("Steps", f"{taken}; the number of steps along a branch is not planned"))
    else:
        found.append(("Steps", f"{taken} of {planned} planned"))
        found.append(("Further steps: increments cut, corners of inputs", str(_further(run))))
    if "solved" in h:
        found.append(("Solved states; the other rows are interpolated", str(h["solved"].sum())))
        iterations = iterations[h["solved"][1:] == 1]
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
        planned[s.stage] = planned.get(s.stage, 0) + s.count * s.cycles
    return int(sum(max(0, int(n) - planned.get(str(stage), 0)) for stage, n in taken.items()))


def warnings(run: Run) -> list[str]:
    """Warnings about the run, its energy balance and its stored fields."""
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
    with suppress(ConfigError):  # damaged states are reported where their pictures are drawn
        if not run.stored_steps:
            found.append("No fields are stored (output.fields: none), so there are no pictures.")
        elif told := stored_note(run):
            found.append(f"{told.capitalize()}, so there is no picture of the electric field.")
    return found


def _number(value: float, digits: int = 5) -> str:
    return neat(value, digits).replace("-", "−")

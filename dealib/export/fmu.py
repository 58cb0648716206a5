"""A device as an FMU: FMI 2.0, co-simulation, for Linux on x86-64 and as C source."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import re
import shlex
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.device.records import Port
from dealib.errors import PlatformError
from dealib.export.lumped import CubaturePoint, lumped
from dealib.files import whole, write_text
from dealib.results.hermite import nodal
from dealib.results.reader import Run
from dealib.results.tables import DeviceTables
from dealib.versions import installed

_SOURCE = Path(__file__).with_name("device.c")
_SLOTS = 8  # number of variables of a port in device.c
_SI = {  # SI unit of a variable, and the unit of its column in it
    **{"displacement": ("m", 1e-3), "rotation": ("rad", math.pi / 180), "voltage": ("V", 1e3)},
    **{"pressure": ("Pa", 1e3), "force": ("N", 1.0), "moment": ("N.m", 1e-3)},
    **{"charge": ("C", 1e-6), "volume": ("m3", 1e-9)},
}
_MOTION = {  # units of speed, mass and damping
    "displacement": ("m/s", "kg", "N.s/m"),
    "rotation": ("rad/s", "kg.m2", "N.m.s/rad"),
}
_BASE = {  # exponents of kg, m, s, A, rad
    **{"m": (0, 1), "rad": (0, 0, 0, 0, 1), "V": (1, 2, -3, -1), "Pa": (1, -1, -2)},
    **{"N": (1, 1, -2), "N.m": (1, 2, -2), "C": (0, 0, 1, 1), "m3": (0, 3), "m/s": (0, 1, -1)},
    **{"rad/s": (0, 0, -1, 0, 1), "kg": (1,), "kg.m2": (1, 2), "N.s/m": (1, 0, -1)},
    **{"N.m.s/rad": (1, 2, -1, 0, -1), "J": (1, 2, -2)},
}


@dataclass(frozen=True)
class _Axis:
    """An axis of the tables in SI units.

    Attributes:
        port: Its port.
        grid: Its values.
        scale: The unit of its column in SI units.
        mass: Mass or moment of inertia that moves with the port.
        damping: Force per speed, in addition to the branches.
    """

    port: Port
    grid: Array
    scale: float
    mass: float
    damping: float

    @property
    def moves(self) -> bool:
        """Whether the port has a mass."""
        return self.port.kind.primal.name in _MOTION

    @property
    def start(self) -> list[float]:
        """Start values of its variables, in the order of device.c."""
        x = float(np.clip(0.0, self.grid[0], self.grid[-1]))
        return [x, 0.0, 0.0, x, 0.0, self.mass, self.damping, x]

    def variables(self) -> Iterator[tuple[int, str, str, str, str]]:
        """Slot, name, causality, unit and description of each of its variables."""
        kind = self.port.kind
        name, (x, unit), (f, of) = (
            self.port.name,
            *((v.name, _SI[v.name][0]) for v in kind.variables),
        )
        if not self.moves:
            yield 0, f"{name}.{x}", "input", unit, "prescribed"
            yield 2, f"{name}.{f}", "output", of, f"{f} of the device"
            return
        speed, mass, damping = _MOTION[x]
        free = f"{name}.{f}_driven"
        yield 0, f"{name}.{x}_in", "input", unit, f"prescribed {x}; without effect if {free}"
        yield 1, f"{name}.{f}_in", "input", of, f"external {f} on the port, if {free}"
        yield 2, f"{name}.{f}", "output", of, f"{f} that holds the port in place, without inertia"
        yield 3, f"{name}.{x}", "output", unit, f"{x} of the port"
        yield 4, f"{name}.{x}_rate", "output", speed, f"rate of the {x} if {free}, otherwise 0"
        yield 5, f"{name}.mass", "parameter", mass, f"inertia that moves with the port if {free}"
        yield 6, f"{name}.damping", "parameter", damping, f"in addition to branches, if {free}"
        yield 7, f"{name}.{x}_start", "parameter", unit, f"{x} at the start, at rest, if {free}"


def compiler() -> list[str]:
    """The command of the C compiler: $CC, or cc.

    Raises:
        PlatformError: If there is none, or the machine is not x86-64.
    """
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]) is None:
        raise PlatformError(
            f"an FMU needs a C compiler, and there is no {command[0]}: install gcc and libc6-dev, "
            "or name one in the environment variable CC"
        )
    if platform.machine() != "x86_64":
        raise PlatformError(f"FMUs can be made on x86-64 only, not on {platform.machine()}")
    return command


def write_fmu(path: Path, run: Run, tables: DeviceTables, config: Config) -> str:
    """Write the FMU of a device.

    Args:
        path: The file; it is replaced.
        run: The run of the relaxed device over the grid of its tables.
        tables: Its tables, with the rows of their nodes.
        config: The device with its branches.

    Returns:
        A line about its branches.

    Raises:
        ConfigError: If the run lacks fields that branches or masses need.
        PlatformError: If the compiler is missing or fails, or the file cannot be written.
    """
    points, masses = lumped(run, tables, config)
    axes = list(_axes(tables, config, masses))
    code, data = _SOURCE.read_text(), _header(axes, tables, points)
    guid = hashlib.sha256((code + data).encode()).hexdigest()[:32]
    model = re.sub(r"\W|^(?=\d)", "_", config.name, flags=re.ASCII)
    files = {_SOURCE.name: code, "tables.h": f'#define GUID "{guid}"\n{data}'}
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden"]
    command = [*compiler(), *flags, _SOURCE.name, "-o", f"{model}.so", "-lm"]
    with tempfile.TemporaryDirectory() as folder, whole(path) as temporary:
        for name, text in files.items():
            write_text(Path(folder) / name, text)
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
        if done.returncode:
            raise PlatformError(f"{shlex.join(command)} failed:\n{done.stderr.strip()}")
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr("modelDescription.xml", _description(model, guid, axes, config))
            file.write(Path(folder) / f"{model}.so", f"binaries/linux64/{model}.so")
            for name, text in files.items():
                file.writestr(f"sources/{name}", text)
    branches = sum(len(point.branches) for point in points)
    return f"branches at {len(points)} points, {branches} altogether" if points else "no branches"


def _axes(tables: DeviceTables, config: Config, bodies: Sequence[float]) -> Iterator[_Axis]:
    assert config.tables is not None
    rest = [np.clip(0.0, grid[0], grid[-1]) for grid in tables.axes.values()]
    for (grid, name), body in zip(
        zip(tables.axes.values(), config.tables.grids, strict=True), bodies, strict=True
    ):
        port, (stem, dot, suffix) = config.device.variables[name], name.partition(".")
        scale, dual, mass, damping = _SI[stem][1], port.kind.dual.name, 0.0, 0.0
        if stem in _MOTION:
            stiffness = tables.slope(dual + dot + suffix, name, *rest) * _SI[dual][1] / scale
            # the inertia of a rotation is in kg mm^2 / deg^2
            mass = port.mass + body * (1.0 if stem == "displacement" else 1e-6 / scale**2)
            rayleigh = config.damping
            damping = rayleigh.mass * mass + rayleigh.stiffness * max(float(stiffness), 0.0)
        yield _Axis(port, scale * grid, scale, mass, damping)


def _header(axes: list[_Axis], tables: DeviceTables, points: list[CubaturePoint]) -> str:
    """Text of tables.h: all numbers of the model, in SI units."""
    n, grids = len(axes), list(tables.axes.values())
    found = [1e-3 * tables.derivatives[..., None]]
    for point in points:
        found.append(np.stack(list(nodal(grids, point.metric).values()), axis=-2))
    table = np.concatenate(found, axis=-1)  # (*grid, 2^axes, tables)
    for k, axis in enumerate(axes):
        slopes = np.arange(2**n) >> (n - 1 - k) & 1
        table = table / axis.scale ** slopes[:, None]
    branches = [(k, p.volume, b) for k, p in enumerate(points) for b in p.branches]
    sizes = {"AXES": n, "POINTS": len(points), "NETWORKS": len(branches)}
    sizes |= {"METRIC": points[0].metric.shape[-1] if points else 0, "TABLES": table.shape[-1]}
    arrays: dict[str, Any] = {
        "const char *const NAME[]": "{" + ", ".join(_quoted(a.port.name) for a in axes) + "}",
        "const int MECHANICAL[]": [int(a.moves) for a in axes],
        "const int COUNT[]": [len(a.grid) for a in axes],
        "const double SIGN[]": [a.port.kind.sign for a in axes],
        **{f"const double GRID_{k}[]": a.grid for k, a in enumerate(axes)},
        "const double *const GRID[]": "{" + ", ".join(f"GRID_{k}" for k in range(n)) + "}",
        f"const double VALUES[AXES + 1][{_SLOTS}]": [a.start for a in axes],
        "const int POINT[]": [k for k, _, _ in branches] or [0],
        "const int LINEAR[]": [int(b.evolution == "network") for *_, b in branches] or [0],
        "const double TIME[]": [b.relaxation_time for *_, b in branches] or [0],
        # MPa mm^3 = mJ
        "const double MODULUS[]": [1e-3 * v * b.shear_modulus for _, v, b in branches] or [0],
        f"const double TABLE[][{2**n}][TABLES]": table.reshape(-1, *table.shape[-2:]),
    }
    lines = [f"enum {{ {', '.join(f'{k} = {v}' for k, v in sizes.items())} }};"]
    lines += [f"static {name} = {_braced(values)};" for name, values in arrays.items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A C string in which each byte is an octal escape, so that any name is valid."""
    return '"' + "".join(f"\\{byte:03o}" for byte in text.encode()) + '"'


def _braced(values: Any) -> str:
    text = values if isinstance(values, str) else str(np.asarray(values).tolist())
    return text.replace("[", "{").replace("]", "}").replace("}, {", "},\n{")


def _description(model: str, guid: str, axes: list[_Axis], config: Config) -> bytes:
    """Text of modelDescription.xml."""

    def add(parent: Any, tag: str, **values: object) -> Any:
        given = {k: re.sub(r"[^ -\ud7ff\ue000-\U0010ffff]", " ", str(v)) for k, v in values.items()}
        node = ET.Element(tag, given)  # XML has no control characters
        parent.append(node)
        return node

    names = [axis.port.name for axis in axes]
    plain = all(re.fullmatch(r"[^\W\d]\w*(\.[^\W\d]\w*)*", n, re.ASCII) for n in names)
    root = add(
        [],
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=config.name,
        guid=guid,
        description=config.description,
        generationTool=f"dealib {installed().get('dealib', '')}",
        variableNamingConvention="structured" if plain else "flat",
    )
    can = ("HandleVariableCommunicationStepSize", "InterpolateInputs", "GetAndSetFMUstate")
    able = {f"can{what}": "true" for what in (*can, "SerializeFMUstate")}
    sources = add(add(root, "CoSimulation", modelIdentifier=model, **able), "SourceFiles")
    add(sources, "File", name=_SOURCE.name)
    units, bases = add(root, "UnitDefinitions"), ("kg", "m", "s", "A", "rad")
    for name, powers in _BASE.items():
        exponents = {k: p for k, p in zip(bases, powers, strict=False) if p}
        add(add(units, "Unit", name=name), "BaseUnit", **exponents)
    logs = add(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        add(logs, "Category", name=name)
    add(root, "DefaultExperiment", startTime=0, stopTime=1, stepSize=1e-3)
    variables, outputs = add(root, "ModelVariables"), []
    for k, axis in enumerate(axes):
        for slot, name, causality, unit, told in axis.variables():
            varies = {"parameter": "fixed" if slot == 7 else "tunable"}.get(causality, "continuous")
            known = {"name": name, "valueReference": _SLOTS * k + slot, "causality": causality}
            node = add(variables, "ScalarVariable", **known, variability=varies, description=told)
            start = {} if causality == "output" else {"start": axis.start[slot]}
            add(node, "Real", unit=unit, **start)
            outputs += [len(variables)] if causality == "output" else []
        if axis.moves:
            name = f"{axis.port.name}.{axis.port.kind.dual.name}_driven"
            told = "the port moves under the external load, with its mass"
            known = {"name": name, "valueReference": k, "causality": "parameter"}
            node = add(variables, "ScalarVariable", **known, variability="fixed", description=told)
            add(node, "Boolean", start="false")
    known = {"name": "energy", "valueReference": _SLOTS * len(axes), "causality": "output"}
    told = "elastic minus electric energy, including the branches"
    node = add(variables, "ScalarVariable", **known, variability="continuous", description=told)
    add(node, "Real", unit="J")
    structure = add(root, "ModelStructure")
    for part in (add(structure, "Outputs"), add(structure, "InitialUnknowns")):
        for index in (*outputs, len(variables)):
            add(part, "Unknown", index=index)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))

"""The run directory on disk: written so that a kill at any moment leaves it readable."""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from dealib.errors import PlatformError
from dealib.results.elements import Array, Cell
from dealib.results.mesh import ResultMesh

HISTORY, STATES, FIELDS, INFO = "history.csv", "results.h5", "fields.xdmf", "run.json"
FIELD_DATA = "fields"  # folder of the HDF5 files beside fields.xdmf
COMPONENTS = ["u_R_mm", "u_Z_mm", "phi_kV", "p_MPa"]  # the last one in the mixed form only
STATE_DATA = "states"  # the same beside results.h5, while the run goes on


@contextmanager
def _guarded(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise PlatformError(f"cannot write {path}: {reason}") from None


@contextmanager
def _new_file(path: Path) -> Iterator[Any]:
    """An HDF5 file that appears under its name only when it is complete."""
    temporary = path.with_name(path.name + ".tmp")
    with _guarded(path):
        with h5py.File(temporary, "w") as file:
            yield file
        os.replace(temporary, path)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises:
        PlatformError: If the disk refuses.
    """
    temporary = path.with_name(path.name + ".tmp")
    with _guarded(path):
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)


class HistoryFile:
    """`history.csv`: one flushed line a converged step."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / HISTORY
        self._columns: list[str] | None = None

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row; the first one writes the header."""
        with _guarded(self.path), self.path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(row))
            if self._columns is None:
                self._columns = list(row)
                writer.writeheader()
            writer.writerow({k: _text(v) for k, v in row.items()})


def _text(value: Any) -> Any:
    return repr(float(value)) if isinstance(value, float) else value


class StateFile:
    """`results.h5`: mesh, config, versions, history and nodal states.

    While the run goes on each state is a file of its own and `results.h5`, replaced whole at each
    step, links to them; `close` gathers everything into the one file.
    """

    def __init__(self, directory: Path, mesh: ResultMesh, texts: Mapping[str, str]) -> None:
        self.path, self.folder = directory / STATES, directory / STATE_DATA
        self._texts = dict(texts)
        self._history: dict[str, list[Any]] = {}
        self._links: list[str] = []
        with _guarded(self.folder):
            self.folder.mkdir(exist_ok=True)
        with _new_file(self.folder / "mesh.h5") as file:
            file["points_mm"], file["cells"] = mesh.points, mesh.cells
            file["region"] = mesh.region
            file.attrs["cell"], file.attrs["order"] = mesh.cell.name, mesh.cell.order
            file.attrs["region_names"] = list(mesh.names)
        self._write()

    def add(self, row: Mapping[str, Any], state: Array | None) -> None:
        """Append a row of the history, and its state if it is to be stored."""
        for name, value in row.items():
            self._history.setdefault(name, []).append(value)
        if state is not None:
            name = f"{row['step']:05d}"
            with _new_file(self.folder / f"{name}.h5") as file:
                file["state"] = state
                file["state"].attrs["time_s"] = row["time_s"]
                file["state"].attrs["components"] = COMPONENTS[: state.shape[1]]
            self._links.append(name)
        self._write()

    def close(self) -> None:
        """Gather the states into `results.h5`."""
        self._write(gather=True)
        with _guarded(self.folder):
            shutil.rmtree(self.folder)

    def _write(self, gather: bool = False) -> None:
        with _new_file(self.path) as file:
            for name, text in self._texts.items():
                file[name] = text
            history = file.create_group("history")
            for name, values in self._history.items():
                kind = h5py.string_dtype() if isinstance(values[0], str) else None
                history.create_dataset(name, data=values, dtype=kind)
            states = file.create_group("states")
            links = {f"states/{name}": (f"{name}.h5", "/state") for name in self._links}
            for key, (source, path) in {**links, "mesh": ("mesh.h5", "/")}.items():
                if gather:
                    with h5py.File(self.folder / source, "r") as part:
                        part.copy(path, file, name=key)
                else:
                    file[key] = h5py.ExternalLink(f"{STATE_DATA}/{source}", path)
            assert len(states) == len(links)


class FieldFile:
    """`fields.xdmf`: one grid a step with all fields, one small HDF5 file each.

    Each file is written under a temporary name and then renamed; the XML follows its data.
    """

    _HEAD = '<?xml version="1.0" ?>\n<Xdmf Version="3.0"><Domain>\n'
    _HEAD += '<Grid Name="steps" GridType="Collection" CollectionType="Temporal">\n'
    _TAIL = "</Grid>\n</Domain></Xdmf>\n"

    def __init__(self, directory: Path, mesh: ResultMesh) -> None:
        self.path, self.data = directory / FIELDS, directory / FIELD_DATA
        with _guarded(self.data):
            self.data.mkdir(exist_ok=True)
        self.mesh = mesh
        self._grids: list[str] = []
        points = np.column_stack([mesh.points, np.zeros(len(mesh.points))])
        self._write("mesh.h5", {"points": points, "cells": mesh.cells, "region": mesh.region})

    def add(self, step: int, time: float, fields: Mapping[str, Array]) -> None:
        """Add a step; times must grow."""
        name = f"step_{step:05d}.h5"
        self._write(name, fields)
        self._grids.append(self._grid(name, time, fields))
        write_text(self.path, self._HEAD + "".join(self._grids) + self._TAIL)

    def _write(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        with _new_file(self.data / name) as file:
            for key, values in arrays.items():
                kind = "f4" if values.dtype.kind == "f" and name != "mesh.h5" else None
                file.create_dataset(key, data=values, dtype=kind)

    def _grid(self, name: str, time: float, fields: Mapping[str, Array]) -> str:
        cells, nodes = self.mesh.cells.shape
        n, kind = len(self.mesh.points), self.mesh.cell.xdmf_type
        lines = [
            f'<Grid Name="step"><Time Value="{time!r}" />',
            f'<Topology TopologyType="{kind}" NumberOfElements="{cells}">',
            _item("mesh.h5", "cells", (cells, nodes), "Int", 8) + "</Topology>",
            '<Geometry GeometryType="XYZ">'
            + _item("mesh.h5", "points", (n, 3), "Float", 8)
            + "</Geometry>",
            '<Attribute Name="region" AttributeType="Scalar" Center="Cell">'
            + _item("mesh.h5", "region", (cells,), "Int", 8)
            + "</Attribute>",
        ]
        for key, values in fields.items():
            sort = {1: "Scalar", 2: "Vector", 3: "Tensor"}[values.ndim]
            shape = (n,) if values.ndim == 1 else (n, int(np.prod(values.shape[1:])))
            lines.append(
                f'<Attribute Name="{key}" AttributeType="{sort}" Center="Node">'
                + _item(name, key, shape, "Float", 4)
                + "</Attribute>"
            )
        return "\n".join(lines) + "\n</Grid>\n"


def _item(file: str, key: str, shape: tuple[int, ...], kind: str, size: int) -> str:
    dims = " ".join(map(str, shape))
    return (
        f'<DataItem Dimensions="{dims}" NumberType="{kind}" Precision="{size}" Format="HDF">'
        f"{FIELD_DATA}/{file}:/{key}</DataItem>"
    )


def write_info(directory: Path, info: Mapping[str, Any]) -> None:
    """Write `run.json`."""
    write_text(directory / INFO, json.dumps(info, indent=2) + "\n")


def read_mesh(file: Any) -> ResultMesh:
    """The mesh of an open `results.h5`."""
    group = file["mesh"]
    return ResultMesh(
        Cell(str(group.attrs["cell"]), int(group.attrs["order"])),
        group["points_mm"][:],
        group["cells"][:],
        group["region"][:],
        tuple(map(str, group.attrs["region_names"])),
    )

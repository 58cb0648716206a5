"""History, states and `run.json` of a run directory, readable after a kill at any moment."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.files import guarded, write_text
from dealib.results.elements import Cell
from dealib.results.hdf5 import memory_hdf5, new_hdf5, write_hdf5
from dealib.results.history import HISTORY
from dealib.results.info import INFO
from dealib.results.mesh import ResultMesh
from dealib.results.rows import Rows, in_parts

STATES = "results.h5"
STATE_DATA = "states"  # folder of the states' files beside it, while the run goes on


class HistoryFile:
    """`history.csv`: one flushed line per converged step.

    Args:
        directory: The run directory.
        keep: Continue after this step; later rows are dropped.
    """

    def __init__(self, directory: Path, keep: int = -1) -> None:
        self.path = directory / HISTORY
        self._columns: list[str] | None = None
        if keep < 0:
            with guarded(self.path):
                self.path.unlink(missing_ok=True)
            return
        header, *rows = self.path.read_text(encoding="utf-8").splitlines()
        self._columns = next(csv.reader([header]))
        where = self._columns.index("step")
        kept = [r for r in rows if int(next(csv.reader([r]))[where]) <= keep]
        write_text(self.path, "".join(line + "\n" for line in (header, *kept)))

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row; the first one writes the header.

        Raises:
            PlatformError: If the disk refuses; half a line is then removed.
        """
        text = io.StringIO()
        writer = csv.DictWriter(text, self._columns or list(row), lineterminator="\n")
        if self._columns is None:
            self._columns = list(row)
            writer.writeheader()
        writer.writerow({k: _text(v) for k, v in row.items()})
        with guarded(self.path), self.path.open("ab", buffering=0) as file:
            end = file.tell()
            data = text.getvalue().encode()
            try:
                if file.write(data) < len(data):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError:
                file.truncate(end)
                raise


def _text(value: Any) -> Any:
    return repr(float(value)) if isinstance(value, float) else value


def _keep(file: Any, name: str, values: npt.NDArray[Any] | Rows) -> None:
    """Store an array with checksums, so that reading notices damage."""
    if isinstance(values, np.ndarray):
        file.create_dataset(name, data=values, fletcher32=True)
        return
    found = file.create_dataset(name, values.shape, "f8", fletcher32=True)
    for rows, part in in_parts(values):
        found[rows] = part


# arrays that a state may have: internal variables (see `fields.Fields`), (cells, points, entries,
# 4), modes, (modes, nodes, axes), and velocities, (nodes, axes)
_MORE = ("internal", "modes", "velocity")
_CHUNK = 64  # rows of the history that are allocated at a time


class StateFile:
    """`results.h5`: mesh, config, versions, history and nodal states.

    While the run continues, each state is a file of its own. `results.h5`, which links to them, is
    kept in memory; `flush` replaces it as a whole, and `close` copies everything into it.

    Args:
        directory: The run directory.
        mesh: Mesh of the states.
        axes: Names of its coordinates.
        texts: Texts to store, by name.
        keep: Continue after this step; later ones are dropped.
    """

    def __init__(
        self,
        directory: Path,
        mesh: ResultMesh,
        axes: tuple[str, ...],
        texts: Mapping[str, str],
        keep: int = -1,
    ) -> None:
        # p exists in the mixed form only
        self._components = [*(f"u_{axis}_mm" for axis in axes), "phi_kV", "p_MPa"]
        self.path, self.folder = directory / STATES, directory / STATE_DATA
        with guarded(self.folder):
            self.folder.mkdir(exist_ok=True)
        with new_hdf5(self.folder / "mesh.h5") as file:
            _keep(file, "points_mm", mesh.points)
            _keep(file, "cells", mesh.cells)
            _keep(file, "region", mesh.region)
            if mesh.normals is not None:
                _keep(file, "normals", mesh.normals)
            file.attrs["cell"], file.attrs["order"] = mesh.cell.name, mesh.cell.order
            file.attrs["region_names"] = list(mesh.names)
        self._file = memory_hdf5()
        for name, text in texts.items():
            self._file[name] = text
        self._link("mesh", "mesh.h5", "/")
        self._file.create_group("states")
        self._history = self._file.create_group("history", track_order=True)
        self._columns: dict[str, Any] = {}  # kept, since h5py's look-up costs as much as writing
        self._rows: list[Mapping[str, Any]] = []  # rows that are not in the file yet
        if keep >= 0:
            self._reopen(keep)
        self.flush()

    def add(
        self, row: Mapping[str, Any], state: Array | None, more: Mapping[str, Rows | None]
    ) -> None:
        """Append a row of the history, and its state if it is to be stored.

        Args:
            row: The row.
            state: Nodal values, (nodes, columns); None if they are not to be stored.
            more: Further arrays of the state, by the names of `_MORE`.
        """
        self._rows.append(row)
        if state is not None:
            name = f"{row['step']:05d}"
            there = {key: values for key, values in more.items() if values is not None}
            size = 8.0 * sum(np.prod(values.shape) for values in (state, *there.values()))
            with new_hdf5(self.folder / f"{name}.h5", size) as file:
                _keep(file, "state", state)
                file["state"].attrs["time_s"] = row["time_s"]
                file["state"].attrs["components"] = self._components[: state.shape[1]]
                for key, values in there.items():
                    _keep(file, key, values)
            self._link_state(name, there)

    def flush(self) -> None:
        """Write all rows and links to the disk."""
        for name in self._rows[0] if self._rows else ():
            self._append(name, [row[name] for row in self._rows])
        self._rows.clear()
        write_hdf5(self.path, self._file)

    def close(self) -> None:
        """Gather the states into `results.h5`."""
        self.flush()
        with new_hdf5(self.path, math.inf) as file:
            self._gather(file)
        with guarded(self.folder):
            shutil.rmtree(self.folder)

    def _reopen(self, keep: int) -> None:
        """Read the history and the states up to step `keep`, in one file or several."""
        with h5py.File(self.path, "r") as file:
            count = int((file["history/step"][:] <= keep).sum())
            for name, values in file["history"].items():
                self._append(name, values[:count])
            for name in file["states"]:
                if int(name) > keep:
                    continue
                link = file["states"].get(name, getlink=True)
                there = [key for key in _MORE if key in file and name in file[key]]
                if not isinstance(link, h5py.ExternalLink):
                    with new_hdf5(self.folder / f"{name}.h5") as part:
                        file.copy(f"states/{name}", part, name="state")
                        for key in there:
                            file.copy(f"{key}/{name}", part, name=key)
                self._link_state(name, there)

    def _append(self, name: str, values: Any) -> None:
        """Append values to a column of the history."""
        if name not in self._columns:
            kind = h5py.string_dtype() if isinstance(values[0], (str, bytes)) else None
            shape = {"maxshape": (None,), "chunks": (_CHUNK,), "fletcher32": kind is None}
            found = self._history.create_dataset(name, data=values, dtype=kind, **shape)
            self._columns[name] = found
            return
        column = self._columns[name]
        column.resize(len(column) + len(values), axis=0)
        column[-len(values) :] = values

    def _link(self, name: str, source: str, path: str) -> None:
        self._file[name] = h5py.ExternalLink(f"{STATE_DATA}/{source}", path)

    def _link_state(self, name: str, more: Iterable[str]) -> None:
        self._link(f"states/{name}", f"{name}.h5", "/state")
        for key in more:
            self._link(f"{key}/{name}", f"{name}.h5", f"/{key}")

    def _gather(self, file: Any) -> None:
        """Copy everything into one file, including what is linked."""
        links = {}

        def copy(group: Any, path: str) -> None:
            if path and path not in file:  # columns of the history keep their order
                file.create_group(path, track_order=True)
            for name in group:
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    links[path + name] = link
                elif isinstance(group[name], h5py.Group):
                    copy(group[name], f"{path}{name}/")
                else:
                    group.copy(name, file[path or "/"])

        copy(self._file, "")
        file.require_group("states")
        for name, link in links.items():
            with h5py.File(self.path.parent / link.filename, "r") as part:
                part.copy(link.path, file, name=name)


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
        group["normals"][:] if "normals" in group else None,
    )

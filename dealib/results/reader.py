"""Reading a run directory, without dolfinx."""

from __future__ import annotations

import io
import json
import os
import platform
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.errors import ConfigError
from dealib.results import store
from dealib.results.elements import Array

if TYPE_CHECKING:
    import pandas
    import pyvista

    from dealib.config.schema import Config
    from dealib.results.mesh import ResultMesh


class Run:
    """A finished, failed or running run.

    Args:
        directory: The run directory.

    Raises:
        ConfigError: If the directory holds no run.
    """

    def __init__(self, directory: str | Path) -> None:
        self.directory = Path(directory)
        if not (self.directory / store.INFO).is_file():
            raise ConfigError(f"{self.directory}: no run here (there is no {store.INFO})")

    def __repr__(self) -> str:
        return f"<Run {self.directory}: {self.status}>"

    @property
    def info(self) -> dict[str, Any]:
        """What `run.json` says: status, versions, timings."""
        path = self.directory / store.INFO
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, OSError):
            raise ConfigError(f"{path}: not readable as JSON; this is no intact run") from None

    @property
    def status(self) -> str:
        """'done', 'not converged', 'interrupted', 'failed', 'running' or 'killed'.

        A run that says it is running, but whose process is gone from this machine, was killed.
        """
        info = self.info
        if info["status"] == "running" and info["host"] == platform.node():
            return "running" if _alive(info["pid"]) else "killed"
        return str(info["status"])

    @cached_property
    def title(self) -> str:
        """Name of its directory, and of its config where that is another: 'thicker (deap100)'."""
        own, config = self.directory.resolve().name, str(self.info["name"])
        return own if own == config else f"{own} ({config})"

    @cached_property
    def history(self) -> pandas.DataFrame:
        """The history, one row a converged step."""
        import pandas as pd

        path = self.directory / store.HISTORY
        if not path.is_file():
            raise ConfigError(f"{self.directory}: no step has converged yet")
        text = path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]  # lines
        return pd.read_csv(io.StringIO(whole), converters={"stage": str})  # even if it is "NA"

    @cached_property
    def config(self) -> Config:
        """The config as it was run."""
        from dealib.config import read

        return read(self.directory / "config.resolved.yaml")

    @cached_property
    def mesh(self) -> ResultMesh:
        """Mesh of the stored states."""
        with self._file() as file:
            return store.read_mesh(file)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose state is stored."""
        with self._file() as file:
            return sorted(int(name) for name in file["states"])

    def _file(self) -> Any:
        import h5py

        return h5py.File(self.directory / store.STATES, "r")

    def state(self, index: int = -1) -> Array:
        """Nodal values of the index-th stored step, (nodes, 3 or 4), see `store.COMPONENTS`."""
        found = self._stored("states", index)
        assert found is not None
        return found

    def internal(self, index: int = -1) -> Array | None:
        """C_i of Maxwell branches at the index-th stored step (see `fields`); None without."""
        return self._stored("internal", index)

    def _stored(self, group: str, index: int) -> Array | None:
        steps = self.stored_steps
        try:
            name = f"{group}/{steps[index]:05d}"
        except IndexError:
            raise ConfigError(
                f"{self.directory}: there are {len(steps)} stored steps, no number {index}"
            ) from None
        with self._file() as file:
            return np.asarray(file[name][:], dtype=np.float64) if name in file else None

    def arrays(self, index: int = -1) -> dict[str, Array]:
        """All nodal fields of the index-th stored step.

        Those of `dealib.results.fields`, and the film's margins (see `dealib.results.margins`).
        """
        from dealib.results import margins
        from dealib.results.fields import fields

        state = self.state(index)
        internal = self.internal(index)
        found = fields(self.config, self.mesh, state, internal)
        return found | margins.fields(self.config, self.mesh, state, internal)

    def fields(self, index: int = -1) -> pyvista.UnstructuredGrid:
        """A pyvista grid of the index-th stored step, with all fields; points undeformed."""
        import pyvista as pv

        mesh = self.mesh
        cells = np.column_stack([np.full(len(mesh.cells), mesh.cells.shape[1]), mesh.cells])
        kinds = np.full(len(cells), mesh.cell.vtk_type, dtype=np.uint8)
        points = np.column_stack([mesh.points, np.zeros(len(mesh.points))])
        grid = pv.UnstructuredGrid(cells.ravel(), kinds, points)
        for name, values in self.arrays(index).items():
            grid.point_data[name] = values.reshape(len(points), -1).squeeze()
        grid.cell_data["region"] = mesh.region
        return grid


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's
        return True
    return True

"""Reading a run directory, without dolfinx."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError, did_you_mean, first_line
from dealib.log import LOGGER
from dealib.results import store
from dealib.results.history import HISTORY, parse
from dealib.results.info import INFO, read_info
from dealib.results.states import StatesReader

if TYPE_CHECKING:
    import pandas
    import pyvista

    from dealib.config.schema import Config
    from dealib.results.mesh import ResultMesh

CONFIG = "config.resolved.yaml"
MESH = "mesh.msh"


class Run:
    """A finished, failed or running run. Damaged parts cause a warning, and the rest is read.

    Args:
        directory: The run directory.
        config: Its config, if that is at hand; default: it is read when it is needed.

    Raises:
        ConfigError: If the directory holds no run.
    """

    def __init__(self, directory: str | Path, config: Config | None = None) -> None:
        self.directory = Path(directory)
        if config is not None:
            self.config = config
        self._told: set[str] = set()
        if any((self.directory / name).is_file() for name in (HISTORY, store.STATES)):
            return
        if not (self.directory / INFO).is_file():
            raise ConfigError(f"{self.directory}: no run here (there is no {INFO})")
        if problem := read_info(self.directory)[1]:
            raise ConfigError(f"{self.directory / INFO}: {problem}; there are no results either")

    def __repr__(self) -> str:
        return f"<Run {self.directory}: {self.status}>"

    @property
    def info(self) -> dict[str, Any]:
        """What `run.json` says: status, versions, timings; without what is damaged."""
        found, problem = read_info(self.directory)
        if problem:
            self._tell(f"{self.directory / INFO}: {problem}; what it cannot tell is unknown")
        return found

    @property
    def status(self) -> str:
        """'done', 'not converged', 'interrupted', 'failed', 'running', 'killed' or 'unknown'.

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
        """The history, one row per converged step; from `results.h5` if the CSV is damaged.

        Raises:
            ConfigError: If no step has converged, or both are damaged.
        """
        try:
            found = self._csv()
        except ConfigError as error:
            if self.states_file.history is None:
                raise self._without(HISTORY, error) from None
            self._tell(f"{error}; the history is that in {store.STATES}")
            found = self.states_file.history
        if found is None:
            raise ConfigError(f"{self.directory}: no step has converged yet")
        return found

    @cached_property
    def _columns(self) -> list[str]:
        """Columns that the device can have; empty if its config is damaged."""
        from dealib.observe.columns import columns

        try:
            return list(columns(self.config))
        except ConfigError:
            return []

    def _csv(self) -> pandas.DataFrame | None:
        """What `history.csv` holds; None if no step has converged."""
        path, kept = (
            self.directory / HISTORY,
            self.states_file.history,
        )  # a run writes the CSV first
        try:
            found = parse(path, self._columns) if path.is_file() else None
        except (OSError, ValueError) as error:
            raise ConfigError(f"{path}: damaged ({first_line(error)})") from None
        if kept is not None and len(kept) > (0 if found is None else len(found)):
            what = "missing" if found is None else "damaged (its last rows are missing)"
            raise ConfigError(f"{path}: {what}")
        return found

    @cached_property
    def config(self) -> Config:
        """The config as it was run; from `results.h5` if its file is damaged.

        Raises:
            ConfigError: If both are damaged.
        """
        from dealib.config import Config, read
        from dealib.config.text import load

        try:
            config = read(self.directory / CONFIG)
        except ConfigError as error:
            kept = self.states_file.text(CONFIG)
            if not kept:
                raise self._without(CONFIG, error) from None
            self._tell(f"{first_line(error)}; the config is that in {store.STATES}")
            config = Config.model_validate(load(kept))
        return self._with_mesh(config)

    def _with_mesh(self, config: Config) -> Config:
        """The config, with the run's copy of the user's mesh file where that file is missing."""
        geometry, copy = config.geometry, self.directory / MESH
        if geometry.shape != "mesh" or Path(geometry.file).exists() or not copy.exists():
            return config
        geometry = geometry.model_copy(update={"file": str(copy), "unit": "mm"})
        return config.model_copy(update={"geometry": geometry})

    def text(self, name: str) -> str:
        """Text of `config.yaml` or `config.resolved.yaml`; empty if it cannot be read."""
        try:
            return (self.directory / name).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return self.states_file.text(name)

    @cached_property
    def states_file(self) -> StatesReader:
        """Reads `results.h5`."""
        return StatesReader(self.directory / store.STATES, self._without)

    @cached_property
    def mesh(self) -> ResultMesh:
        """Mesh of the stored states.

        Raises:
            ConfigError: If `results.h5` is damaged.
        """
        return self.states_file.mesh

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose state is stored, without damaged ones."""
        found, problem = self.states_file.steps()
        if problem:
            self._tell(problem)
        return found

    def check(self) -> None:
        """Check that history and states are intact.

        Raises:
            ConfigError: Naming the first file that is not.
        """
        if self._csv() is not None:
            self.check_states()

    def check_states(self) -> None:
        """Check that mesh and states are intact, by reading them all.

        Raises:
            ConfigError: If they are not.
        """
        _ = self.mesh
        if problem := self.states_file.steps(whole=True)[1]:
            raise ConfigError(problem)

    def _without(self, name: str, error: ConfigError) -> ConfigError:
        """The error about a file, with a list of the other files that can be read."""
        from dealib.config import read

        def is_intact(other: str) -> bool:
            path = self.directory / other
            try:
                if other == INFO:
                    return not read_info(self.directory)[1]
                {HISTORY: parse, CONFIG: read, store.STATES: h5py.File}[other](path)
            except (ConfigError, OSError, ValueError):
                return False
            return True

        others = [n for n in (INFO, HISTORY, CONFIG, store.STATES) if n != name and is_intact(n)]
        return ConfigError(f"{error}; still readable: {', '.join(others) or 'nothing'}")

    def _tell(self, problem: str) -> None:
        """Log a warning, each one only once."""
        if problem not in self._told:
            self._told.add(problem)
            LOGGER.warning("%s", problem)

    def table(self, name: str) -> pandas.DataFrame:
        """A table beside the run: 'modes', 'frequencies', 'response', 'circuit'.

        Raises:
            ConfigError: If the run has none of this name, or it is damaged.
        """
        from dealib.results import spectra

        there = [path.stem for path in sorted(self.directory.glob("*.csv"))]
        if name not in there:
            raise ConfigError(f"{self.directory}: no table {name!r}{did_you_mean(name, there)}")
        return spectra.read(self.directory / f"{name}.csv")

    def state(self, index: int = -1) -> Array:
        """Nodal values of the index-th stored step, (nodes, columns): u, phi, p in the mixed form.

        Units are mm, kV and MPa.
        """
        found = self._stored("states", index)
        assert found is not None
        return found

    def states(self, steps: Iterable[int]) -> Iterator[Array]:
        """Nodal values of stored steps, given by their step numbers."""
        return self.states_file.nodal(steps)

    def internal(self, index: int = -1) -> Array | None:
        """Internal variables at the index-th stored step (see `fields.Fields`); None without."""
        return self._stored("internal", index)

    def modes(self, index: int = -1) -> Array | None:
        """Softest modes, (modes, nodes, axes), if stability is lost at the index-th stored step.

        The largest displacement of each mode is 1. None if the step has no modes.
        """
        return self._stored("modes", index)

    def velocity(self, index: int = -1) -> Array | None:
        """Nodal velocity at the index-th stored step, (nodes, axes), mm/s; None at rest."""
        return self._stored("velocity", index)

    def _stored(self, group: str, index: int) -> Array | None:
        return self.states_file.array(group, self.stored_steps, index)

    def arrays(self, index: int = -1) -> dict[str, Array]:
        """All nodal fields of the index-th stored step, by name.

        These are the fields of `dealib.results.fields` and `dealib.results.margins`, the softest
        modes 'mode', 'mode2', ... where stability is lost, and in motion the 'velocity'.
        """
        from dealib.results import margins
        from dealib.results.fields import fields, named

        state = self.state(index)
        internal = self.internal(index)
        found = fields(self.config, self.mesh, state, internal) | named(
            self.modes(index), self.velocity(index)
        )
        return found | margins.fields(self.config, self.mesh, state, internal)

    def fields(self, index: int = -1) -> pyvista.UnstructuredGrid:
        """A pyvista grid of the index-th stored step with all fields; its points are undeformed."""
        import pyvista as pv

        mesh = self.mesh
        cells = np.column_stack([np.full(len(mesh.cells), mesh.cells.shape[1]), mesh.cells])
        kinds = np.full(len(cells), mesh.cell.vtk_type, dtype=np.uint8)
        n, axes = mesh.points.shape
        points = np.column_stack([mesh.points, np.zeros((n, 3 - axes))])
        grid = pv.UnstructuredGrid(cells.ravel(), kinds, points)
        for name, values in self.arrays(index).items():
            grid.point_data[name] = values.reshape(len(points), -1).squeeze()
        grid.cell_data["region"] = mesh.region
        return grid


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True

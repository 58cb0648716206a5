"""Writing of converged states, in an order that leaves the files consistent after a kill."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.results import paraview, store, xdmf
from dealib.results.checkpoint import INTERNAL, CheckpointFolder
from dealib.results.fields import Fields, named
from dealib.results.mesh import ResultMesh
from dealib.results.rows import Stream, Transferred


@dataclass(frozen=True)
class WriterSetup:
    """What a writer needs to open the files of a run.

    Attributes:
        directory: The run directory.
        config: The run's config.
        mesh: Mesh of the states.
        texts: Texts that `results.h5` holds, by name.
        done: Continue after this step; later ones are dropped.
        resumable: Whether each step writes a checkpoint and flushes `results.h5`.
    """

    directory: Path
    config: Config
    mesh: ResultMesh
    texts: Mapping[str, str]
    done: int
    resumable: bool = True


@dataclass(frozen=True)
class Record:
    """A converged state, ready to be written.

    Attributes:
        row: Row of the history.
        state: Nodal values, (nodes, columns); None if they are not needed.
        stored: Whether state and fields are stored as results, besides the checkpoint.
        values: Plain values for the checkpoint.
        keep: How many states a checkpoint keeps.
        beside: Further arrays of the checkpoint, if there are any: 'internal' (internal variables,
            which may be a `Stream`), 'rates' (velocities and accelerations), 'charges' (of
            resistive electrodes).
        to_gauss: Matrix from the internal variables' points to Gauss points, (Gauss points,
            points); None if the state is not stored, or has no such variables.
        modes: Displacements of modes where stability is lost, (modes, nodes, axes).
        between: Interpolated rows of the history since the record before.
    """

    row: dict[str, Any]
    state: Array | None
    stored: bool
    values: dict[str, Any]
    keep: int
    beside: Mapping[str, Any] = field(default_factory=dict)
    to_gauss: Array | None = None
    modes: Array | None = None
    between: Sequence[Mapping[str, Any]] = ()


class Writer(Protocol):
    """Writes records."""

    def add(self, record: Record) -> None:
        """Write a record, now or soon.

        Raises:
            PlatformError: If the disk refuses this record or an earlier one.
        """

    def wait(self) -> None:
        """Return when all records are written."""

    def close(self) -> float:
        """Write the remaining records and merge `results.h5`; returns the seconds spent writing."""


class StepWriter:
    """Writes each record in the step itself."""

    def __init__(self, opening: WriterSetup) -> None:
        directory, mesh, done = opening.directory, opening.mesh, opening.done
        self.seconds = 0.0
        self._mesh = mesh.fingerprint
        self._history = store.HistoryFile(directory, done)
        self._states = store.StateFile(
            directory, mesh, opening.config.device.kinematics.axes, opening.texts, done
        )
        self._checkpoint = CheckpointFolder(directory) if opening.resumable else None
        self._fields: xdmf.FieldFile | None = None
        if opening.config.output.fields != "none":
            self._fields = xdmf.FieldFile(directory, mesh, done)
            self._derive = Fields(opening.config, mesh)
            paraview.write(directory, mesh)

    def add(self, record: Record) -> None:
        """See `Writer`. The checkpoint comes last, so that all files have what it refers to."""
        begin = time.perf_counter()
        row, state, beside = record.row, record.state, dict(record.beside)
        rates, internal, at_gauss = beside.get("rates"), beside.get(INTERNAL), None
        if isinstance(internal, Stream):  # it comes once: what follows reads it from the disk
            if self._checkpoint is None:
                internal = internal.whole()
            else:
                internal = self._checkpoint.keep(INTERNAL, row["step"], internal)
            beside[INTERNAL] = internal
        if internal is not None and record.to_gauss is not None:
            at_gauss = Transferred(internal, record.to_gauss)
        velocity = None if rates is None else rates[0]
        if self._fields is not None and record.stored and state is not None:
            derived = self._derive(state, at_gauss) | named(record.modes, velocity)
            self._fields.add(row["step"], row["time_s"], derived)
        for interpolated in record.between:
            self._history.add(interpolated)
            self._states.add(interpolated, None, {})
        self._history.add(row)
        more = {"internal": at_gauss, "modes": record.modes, "velocity": velocity}
        self._states.add(row, state if record.stored else None, more)
        if self._checkpoint is not None and state is not None:
            self._states.flush()
            rows = [*record.between, row]
            kept = (state, record.keep, beside)
            self._checkpoint.write(record.values, self._mesh, *kept, rows)
        self.seconds += time.perf_counter() - begin

    def wait(self) -> None:
        """See `Writer`."""

    def close(self) -> float:
        """See `Writer`."""
        begin = time.perf_counter()
        self._states.close()
        return self.seconds + time.perf_counter() - begin

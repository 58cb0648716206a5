"""The checkpoint from which a run is resumed, replaced as a whole after each converged step."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError, anew
from dealib.files import guarded, write_bytes, write_parts
from dealib.results.rows import Stored, Stream

FOLDER, VALUES, STATE, INTERNAL = "checkpoint", "program.json", "state", "internal"


@dataclass(frozen=True)
class Checkpoint:
    """A saved state.

    Attributes:
        values: Plain values of the program.
        mesh: Fingerprint of the mesh that the states belong to.
        states: Nodal values of the last converged steps, (nodes, columns), newest last; on rank 0.
        beside: Further arrays of the last step, by name (see `Record.beside`); on rank 0. Internal
            variables stay in their file.
        history: Checksum of the history's rows up to the last step (see `chained`).
    """

    values: dict[str, Any]
    mesh: str
    states: list[Array] = field(default_factory=list)
    beside: dict[str, Any] = field(default_factory=dict)
    history: str = ""

    @property
    def step(self) -> int:
        """Number of the last converged step."""
        return int(self.values["progress"]["step"])


class CheckpointFolder:
    """`checkpoint/`: the last states, and the values that belong to them.

    A new state is a new file. The values, which name the step, are replaced after it, so that one
    complete checkpoint exists at every moment. The file of the values also holds checksums of all
    files and of the rows of the history.
    """

    def __init__(self, directory: Path) -> None:
        self.folder = directory / FOLDER
        self._sums: dict[str, str] | None = None  # of the files; None until they are known
        self._history = ""

    def write(
        self,
        values: dict[str, Any],
        mesh: str,
        state: Array,
        keep: int,
        beside: Mapping[str, Array | Stored | None],
        rows: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Save a step, safe on the disk when this returns, and keep some states before it.

        Args:
            values: Plain values of the program.
            mesh: Fingerprint of the mesh.
            state: Nodal values.
            keep: How many states to keep.
            beside: See `Record.beside`; what is `Stored` already, `keep` has written.
            rows: Of the history since the save before; default the program's last one.

        Raises:
            PlatformError: If the disk refuses; the previous checkpoint is then intact.
        """
        step, sums = Checkpoint(values, mesh).step, self._known()
        for name, array in {STATE: state, **beside}.items():
            if array is not None and not isinstance(array, Stored):
                self.keep(name, step, array)
        gone = [self._array(STATE, k) for k in self._steps(STATE, sums)[:-keep]]
        gone += [self._array(n, k) for n in beside for k in self._steps(n, sums) if k != step]
        for path in gone:
            sums.pop(path.name, None)
        for row in rows or [values["progress"]["row"]]:
            self._history = chained(self._history, row)
        held = {"mesh": mesh, "values": values, "history": self._history}
        text = json.dumps({**held, "sums": {**sums, VALUES: _sum_of_values(values)}})
        write_bytes(self.folder / VALUES, text.encode(), durable=True)
        for path in gone:
            path.unlink(missing_ok=True)

    def keep(self, name: str, step: int, array: Array | Stream) -> Stored:
        """Write an array of a step, safe on the disk when this returns.

        It belongs to a checkpoint only after `write`.

        Raises:
            PlatformError: If the disk refuses.
        """
        sums, path = self._known(), self._array(name, step)
        with guarded(self.folder):
            self.folder.mkdir(exist_ok=True)
        sums[path.name] = _save(path, array)
        return Stored(path)

    def _known(self) -> dict[str, str]:
        """Checksums of the files; a run that is resumed knows them from its checkpoint."""
        if self._sums is None:
            found = self._found() or {"sums": {}, "history": ""}
            self._sums, self._history = found["sums"], found["history"]
        return self._sums

    def read(self) -> Checkpoint | None:
        """The last checkpoint, or None if there is none yet.

        Raises:
            ConfigError: If it is not what was written.
        """
        try:
            found = self._found()
            if found is None:
                return None
            sums = found["sums"]
            if sums[VALUES] != _sum_of_values(found["values"]):
                raise ValueError(f"{VALUES} is not what the run has written")
            saved = Checkpoint(found["values"], found["mesh"], history=found["history"])
            step = saved.step
            end = self._array("", step).name
            for name in sums:
                if name.endswith(end) and (of := name.removesuffix(end)) != STATE:
                    array = _checked(self._array(of, step), sums)
                    saved.beside[of] = array if of == INTERNAL else array[:]
            known = len(saved.values["predictor"]["known"])
            there = self._steps(STATE, sums)[-max(known, 1) :]
            saved.states.extend(_checked(self._array(STATE, k), sums)[:] for k in there)
            if step not in there:
                raise ValueError(f"{self._array(STATE, step).name} is missing")
        except Exception as error:  # of a file whose content can be anything
            raise ConfigError(f"{self.folder}: damaged checkpoint ({error}); {anew()}") from None
        return saved

    def _found(self) -> dict[str, Any] | None:
        """Content of the file of values; None before any step has converged."""
        path = self.folder / VALUES
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None

    def _steps(self, name: str, sums: Iterable[str]) -> list[int]:
        """Steps of which an array is held, in order; interpolated rows have none."""
        found = (file.removesuffix(".npy").rpartition("_") for file in sums)
        return sorted(int(step) for of, _, step in found if of == name and step.isdigit())

    def _array(self, name: str, step: int) -> Path:
        return self.folder / f"{name}_{step:05d}.npy"


def history_sum(rows: Iterable[Mapping[str, Any]]) -> str:
    """Checksum of a history."""
    found = ""
    for row in rows:
        found = chained(found, row)
    return found


def chained(before: str, row: Mapping[str, Any]) -> str:
    """Checksum of the rows of a history, from that of the rows before and the next one."""
    cells = sorted(f"{name}={_plain(value)}" for name, value in row.items())
    known = [cell for cell in cells if not cell.endswith(("=", "=nan"))]
    return _sum(json.dumps([before, *known]).encode())


def _plain(value: Any) -> str:
    """A value as it is told apart, wherever it was read from."""
    try:
        return repr(float(value))
    except ValueError:
        return str(value)


def _sum(content: bytes | memoryview) -> str:
    return hashlib.sha256(content).hexdigest()


def _sum_of_values(values: dict[str, Any]) -> str:
    return _sum(json.dumps(values).encode())


def _save(path: Path, array: Array | Stream) -> str:
    """Write an array, as `numpy.save` does; returns its checksum."""
    digest, header = hashlib.sha256(), io.BytesIO()
    given = {"descr": "<f8", "fortran_order": False, "shape": array.shape}
    np.lib.format.write_array_header_1_0(header, given)

    def parts() -> Iterator[Any]:
        yield header.getvalue()
        for rows in array.parts if isinstance(array, Stream) else (array,):
            yield np.ascontiguousarray(rows, dtype="<f8").reshape(-1).view(np.uint8)

    def summed() -> Iterator[Any]:
        for part in parts():
            digest.update(part)
            yield part

    write_parts(path, summed(), durable=True)
    return digest.hexdigest()


def _checked(path: Path, sums: Mapping[str, str]) -> Stored:
    """An array in a file that has its checksum."""
    with path.open("rb") as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != sums[path.name]:
            raise ValueError(f"{path.name} is not what the run has written")
    return Stored(path)

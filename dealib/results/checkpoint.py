"""The checkpoint of a run: what it needs to go on, replaced whole after each converged step."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dealib.errors import ConfigError
from dealib.files import guarded, write_bytes
from dealib.results.elements import Array

FOLDER, VALUES = "checkpoint", "program.json"


@dataclass(frozen=True)
class Checkpoint:
    """A saved state.

    Attributes:
        values: Plain values of the program.
        mesh: Fingerprint of the mesh that the states belong to.
        states: Nodal (u_R, u_Z, phi) of the last converged steps, newest last; on rank 0 only.
        internal: Internal state of Maxwell branches at the last one, if there are any; likewise.
    """

    values: dict[str, Any]
    mesh: str
    states: list[Array] = field(default_factory=list)
    internal: Array | None = None

    @property
    def step(self) -> int:
        """Number of the last converged step."""
        return int(self.values["progress"]["step"])


class CheckpointFolder:
    """`checkpoint/`: the last states, and the values that belong to them.

    A new state is a new file; the values, which name the step, are replaced after it. So there is
    one whole checkpoint at every moment.
    """

    def __init__(self, directory: Path) -> None:
        self.folder = directory / FOLDER

    def write(
        self,
        values: dict[str, Any],
        mesh: str,
        state: Array,
        keep: int,
        internal: Array | None = None,
    ) -> None:
        """Save a step, safe on the disk when this returns, and keep some states before it.

        Raises:
            PlatformError: If the disk refuses; the previous checkpoint is then intact.
        """
        step = Checkpoint(values, mesh).step
        with guarded(self.folder):
            self.folder.mkdir(exist_ok=True)
        _save(self._state(step), state)
        if internal is not None:
            _save(self._internal(step), internal)
        text = json.dumps({"mesh": mesh, "values": values})
        write_bytes(self.folder / VALUES, text.encode(), durable=True)
        self._state(step - keep).unlink(missing_ok=True)
        self._internal(step - 1).unlink(missing_ok=True)

    def read(self) -> Checkpoint | None:
        """The last checkpoint, or None if there is none yet.

        Raises:
            ConfigError: If it is damaged.
        """
        path = self.folder / VALUES
        if not path.is_file():
            return None
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            saved = Checkpoint(found["values"], found["mesh"])
            step = saved.step
            if self._internal(step).is_file():
                saved = replace(saved, internal=np.load(self._internal(step)))
            saved.states.append(np.load(self._state(step)))
            while self._state(step - 1).is_file():
                step -= 1
                saved.states.insert(0, np.load(self._state(step)))
            known = len(saved.values["predictor"]["known"])
            del saved.states[: max(len(saved.states) - known, 0)]
        except Exception as error:  # of a file whose content can be anything
            raise ConfigError(
                f"{self.folder}: damaged checkpoint ({error}); start anew with --overwrite"
            ) from None
        return saved

    def _state(self, step: int) -> Path:
        return self.folder / f"state_{step:05d}.npy"

    def _internal(self, step: int) -> Path:
        return self.folder / f"internal_{step:05d}.npy"


def _save(path: Path, array: Array) -> None:
    buffer = io.BytesIO()
    np.save(buffer, array)
    write_bytes(path, buffer.getbuffer(), durable=True)

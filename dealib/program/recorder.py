"""The observer that writes every converged state."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dealib.config.case import Case
from dealib.errors import PlatformError
from dealib.program.history import State
from dealib.program.simulation import Simulation
from dealib.results.writer import Record, Writer, WriterSetup
from dealib.versions import versions


class Recorder:
    """Passes every state to a writer (on rank 0).

    Args:
        directory: The run directory.
        case: The case.
        begin: Makes the writer.
        resumable: Whether the run can be resumed.
    """

    def __init__(
        self,
        directory: Path,
        case: Case,
        begin: Callable[[WriterSetup], Writer],
        resumable: bool = True,
    ) -> None:
        self._directory, self._case, self._begin = directory, case, begin
        self._resumable = resumable
        self._wanted = case.config.output.fields
        self._writer: Writer | None = None
        self._between: list[dict[str, Any]] = []  # interpolated rows, which go with the next state

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        engine = simulation.engine
        self._timings = engine.timings
        if engine.layout.mesh is None:
            return
        texts = {"config": self._case.text, "config_resolved": self._case.resolved}
        texts |= {f"versions/{k}": v for k, v in versions().items()}
        mesh, done = engine.layout.mesh, simulation.progress.step
        opening = self._directory, self._case.config, mesh, texts, done, self._resumable
        self._writer = self._begin(WriterSetup(*opening))

    def see(self, state: State) -> None:
        """See `Observer`."""
        if not state.solved:
            self._between.append(state.row)
            return
        begin = time.perf_counter()
        ends = state.end_of_stage or state.lost
        stored = self._wanted == "every" or (self._wanted == "stage" and ends)
        nodal, in_time, values = None, dict[str, Any](), dict[str, Any]()
        if stored or self._resumable:
            nodal, in_time = state.nodal(), state.in_time()
        if self._resumable:
            values = state.engine.plain()
        viscosity, internal, to_gauss = state.engine.viscosity, None, None
        if viscosity is not None and (stored or self._resumable):
            # from several ranks it comes while it is written: nothing collective may stand between
            several = state.engine.comm.size > 1
            internal = viscosity.stream() if several else state.internal()
            to_gauss = viscosity.weights() if stored else None
        if self._writer is not None:
            keep = state.engine.predictor.memory
            beside = {"internal": internal, **in_time}
            kept = (nodal, stored, values, keep, beside, to_gauss, state.modes)
            self._writer.add(Record(state.row, *kept, tuple(self._between)))
        self._between.clear()
        self._timings["output"] += time.perf_counter() - begin

    def wait(self) -> None:
        """Return when every state is on the disk."""
        if self._writer is not None:
            self._writer.wait()

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if self._writer is not None and not isinstance(error, PlatformError):
            begin = time.perf_counter()
            self._timings["writing"] = self._writer.close()
            self._timings["output"] += time.perf_counter() - begin

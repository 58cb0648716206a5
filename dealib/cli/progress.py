"""What a user sees while a run goes on: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from dealib.program import Simulation, State


def line(row: dict[str, Any]) -> str:
    """One step in one line."""
    return (
        f"step {row['step']:4d}  t {row['time_s']:9.4g} s  {row['stage']:<12.12s}"
        f"  u {row['displacement_mm']:9.5f} mm  F {row['force_N']:9.5f} N"
        f"  V {row['voltage_kV']:7.4f} kV  C {row['capacitance_pF']:8.3f} pF"
        f"  {row['newton_iterations']:2d} it"
    )


class Progress:
    """An observer that shows progress; a bar on a terminal, plain lines otherwise."""

    def __init__(self) -> None:
        self._console = Console()
        self._bar: Bar | None = None

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        config, n = simulation.case.config, simulation.steps_planned
        head = f"{config.name}: {simulation.unknowns} unknowns, {n} steps"
        if not self._console.is_terminal:
            print(head, flush=True)
            return
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[now]}"),
        )
        self._bar = Bar(*columns, console=self._console)
        self._task = self._bar.add_task(config.name, total=n, now="")
        self._console.print(head, highlight=False)
        self._bar.start()

    def see(self, state: State) -> None:
        """See `Observer`."""
        row = state.row
        for warning in state.warnings:
            self._console.print(f"warning: {warning}", style="yellow", highlight=False)
        if self._bar is None:
            print(line(row), flush=True)
            return
        now = f"{row['stage']}  u {row['displacement_mm']:.4f} mm  V {row['voltage_kV']:.3f} kV"
        total = max(self._bar.tasks[0].total or 0, row["step"])
        self._bar.update(self._task, completed=row["step"], total=total, now=now)

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if self._bar is not None:
            self._bar.stop()
        sys.stdout.flush()


class LogFile:
    """An observer that writes `run.log`, one dated line a step."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / "run.log"

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        cells = 0 if simulation.layout.mesh is None else len(simulation.layout.mesh.cells)
        self._write(
            f"{simulation.case.path}: {cells} cells, {simulation.unknowns} unknowns, "
            f"{simulation.comm.size} ranks"
        )

    def see(self, state: State) -> None:
        """See `Observer`."""
        self._write(line(state.row))
        for warning in state.warnings:
            self._write(f"warning: {warning}")

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        self._write("done" if error is None else f"stopped: {error}")

    def _write(self, text: str) -> None:
        stamp = time.strftime("%Y-%m-%d %H:%M:%S")
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{stamp}  {text}\n")
        except OSError:
            pass  # the log never stops a run; results report a disk that refuses

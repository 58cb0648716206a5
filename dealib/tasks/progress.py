"""Progress of a run: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from dealib.program import Simulation, State
from dealib.program.run import line, ports_told
from dealib.units import counted

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


class Progress:
    """An observer of a run that shows a bar on a terminal, and prints plain lines elsewhere."""

    def __init__(self) -> None:
        self._bar: Bar | None = None

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        config, n = simulation.case.config, simulation.steps_planned
        head = f"{config.name}: {simulation.unknowns} unknowns, {counted(n, 'step')}"
        done = simulation.progress.step
        if done >= 0:
            head += f", resumed after step {done}"
        if not sys.stdout.isatty():
            print(head, flush=True)
            return
        # imported for terminals alone
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        console = Console()
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[now]}"),
        )
        self._bar = Bar(*columns, console=console)
        self._task = self._bar.add_task(config.name, total=n, now="", completed=max(done, 0))
        console.print(head, highlight=False)
        self._bar.start()

    def see(self, state: State) -> None:
        """See `Observer`."""
        row = state.row
        if self._bar is None:
            print(line(row), flush=True)
            return
        now = f"{row['stage']}  {ports_told(row, 'z.4f', ('u', 'p', 'V'))}"
        total = max(self._bar.tasks[0].total or 0, row["step"])
        self._bar.update(self._task, completed=row["step"], total=total, now=now)

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if self._bar is not None:
            self._bar.stop()
        sys.stdout.flush()
        if error is None:  # the summary needs it, and the last states are still being written
            import pandas  # noqa: F401

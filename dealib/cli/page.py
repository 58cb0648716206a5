"""`dealib app` and `dealib view`: pages in the browser."""

from __future__ import annotations

import threading
import webbrowser
from contextlib import suppress
from pathlib import Path

import typer

from dealib.app.page import build, serve
from dealib.config.case import Case
from dealib.results.reader import Run


def show(case: Case, wanted: list[str], port: int, browser: bool) -> None:
    """Show a config under sliders, and solve, until a signal comes."""
    from dealib.app.solving import Session

    session = Session(case, wanted)
    _open(build(session, None, case.config.name), port, browser)
    session.serve()


def view(directory: Path, port: int, browser: bool) -> None:
    """Show a run until a signal comes."""
    run = Run(directory)
    _ = run.history, run.config  # what is damaged is told before the page opens
    _open(build(None, run, run.title), port, browser)
    threading.Event().wait()


def _open(page: object, port: int, browser: bool) -> None:
    address, _ = serve(page, port)
    typer.echo(f"{address} (Ctrl-C ends it)")
    if browser:
        with suppress(webbrowser.Error):
            webbrowser.open(address)

"""`dealib app` and `dealib view`: pages in the browser."""

from __future__ import annotations

import gc
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
    _open(build(session.run, session), port, browser)
    gc.freeze()  # modules come to stay: to look for garbage among them takes 0.1 s
    gc.set_threshold(20_000)
    session.serve()


def view(directory: Path, port: int, browser: bool) -> None:
    """Show a run until a signal comes."""
    run = Run(directory)
    _ = run.history, run.config  # what is damaged is told before the page opens
    _open(build(run), port, browser)
    threading.Event().wait()


def _open(page: object, port: int, browser: bool) -> None:
    address = serve(page, port)
    typer.echo(f"{address} (Ctrl-C ends it)")
    if browser:
        with suppress(webbrowser.Error):
            webbrowser.open(address)

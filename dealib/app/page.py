"""The page: sliders, curves, margins and the deformed device, served to this machine only."""

from __future__ import annotations

import gc
import logging
import socket
import threading
import webbrowser
from contextlib import suppress
from typing import Any

import typer

from dealib.app import drawing
from dealib.config.case import Case
from dealib.errors import ConfigError, DealibError, PlatformError, by_caller
from dealib.plots.labels import label
from dealib.plots.shape import typical_step
from dealib.results.reader import Run
from dealib.results.summary import margins
from dealib.units import neat

_HOST = "127.0.0.1"
_SIDE = {"flex": "1 1 300px", "maxHeight": "94vh", "overflowY": "auto", "padding": "0 24px"}
_WIDE = {"flex": "2 1 420px", "minWidth": 0}
_ROW = {"display": "flex", "flexWrap": "wrap", "gap": "12px", "fontFamily": "sans-serif"}
_RED = {"color": drawing.RED, "fontWeight": "bold"}
_DRAG: dict[str, Any] = {"updatemode": "drag"}


def show(case: Case, wanted: list[str], port: int, browser: bool) -> None:
    """Show a config with sliders, and solve for their positions, until a signal comes."""
    from dealib.app.solving import Session

    session = Session(case, wanted)
    _open(build(session.run, session), port, browser)
    gc.freeze()  # imported modules stay: collecting among them takes 0.1 s
    gc.set_threshold(20_000)
    session.serve()


def view(run: Run, port: int, browser: bool) -> None:
    """Show a run until a signal comes."""
    _open(build(run), port, browser)
    threading.Event().wait()


def _open(page: Any, port: int, browser: bool) -> None:
    address = serve(page, port)
    typer.echo(f"{address} (Ctrl-C ends it)")
    if browser:
        with suppress(webbrowser.Error):
            webbrowser.open(address)


def build(run: Run, session: Any = None) -> Any:
    """Build a page.

    Args:
        run: The run that is shown at first.
        session: The `Session` of a page with sliders; None: a page of the run alone.

    Returns:
        The Dash application.

    Raises:
        PlatformError: If dash is not installed.
    """
    try:
        from dash import ALL, Dash, Input, Output, State, dcc, html, no_update
    except ImportError:
        raise PlatformError(
            "pages need dash, which is not installed: .venv/bin/pip install 'dash>=4,<5'"
        ) from None
    now: dict[str, Any] = {"run": run, "solid": None, "number": 1}  # what is shown
    turn, given = threading.Lock(), [] if session is None else session.sliders
    every, x, y = drawing.columns(run)
    known, ways = drawing.fields(run), drawing.cuts(run)
    names = [{"label": label(c), "value": c} for c in every]
    app = Dash(__name__, title="dealib", update_title="", serve_locally=True)

    def used(run: Run) -> list[Any]:
        tips = [(m, f"{m.meaning}; {m.when} {m.where}") for m in margins(run)]
        return [html.Div(f"{m.name} {m.used}", title=tip, style={} if m.ok else _RED)
                for m, tip in tips]  # fmt: skip

    def slider(name: Any, low: float, high: float, step: float, value: float, **more: Any) -> Any:
        return dcc.Slider(low, high, step, id=name, value=value, **_DRAG, **{"marks": None} | more)

    side = [html.H3(run.title)]
    for key, low, high in given:
        name = {"type": "key", "name": key.name}
        marks = {end: neat(end, 3) for end in (low, high)}
        side.append(html.Small(f"{key.name} ({key.unit})" if key.unit else key.name))
        side.append(slider(name, low, high, (high - low) / 100, key.value, marks=marks))
    side += [html.Button("Save as YAML", id="save"), html.Div(id="saved")] if session else []
    side += [html.Div(run.status, id="status"), html.Div(id="problem", style=_RED)]
    side += [html.Div(used(run), id="margins")]
    side += [dcc.Store(id=name) for name in ("shown", "quick", "full", "check")]
    left = [
        dcc.Dropdown(names, x, id="x", clearable=False),
        dcc.Dropdown(names, y, id="y", multi=True),
        dcc.Graph(id="curves", style={"height": "84vh"}),
    ]
    right = [
        dcc.Dropdown(known, next(iter(known), None), id="field", clearable=False),
        dcc.Dropdown(ways, ways[0], id="cut", clearable=False),
        dcc.Graph(id="device", style={"height": "66vh"}),
        html.Label("stored state"),
        slider("step", 0, max(len(run.stored_steps) - 1, 1), 1, _typical(run)),
        html.Label("place of the cut, over the extent", hidden=len(ways) == 1),
        html.Div(slider("share", 0, 1, 0.02, 0.5), hidden=len(ways) == 1),
    ]
    parts = ((side, _SIDE), (left, _WIDE), (right, _WIDE))
    app.layout = html.Div([html.Div(part, style=style) for part, style in parts], style=_ROW)

    def drawn(x: str, y: list[str]) -> Any:
        found = drawing.curves(now["run"], x, y or [], now["solid"])
        found["layout"]["meta"] = {"number": now["number"]}
        return found

    def answering(level: int, source: Any, to: str) -> None:
        places = [("status", "children"), ("problem", "children"), ("curves", "figure")]
        places += [("shown", "data"), (to, "data")]
        outputs = [Output(*place, allow_duplicate=True) for place in places]
        states = (State("x", "value"), State("y", "value"))
        later = level > 0 or "initial_duplicate"

        @app.callback(*outputs, source, *states, prevent_initial_call=later)
        def answer(values: list[float], x: str, y: list[str]) -> list[Any]:
            found = session.ask(level, tuple(values))
            if found is None:
                return [no_update] * len(outputs)
            if found.problem:
                next_ = no_update if level else values  # more steps may converge
                return [found.told, found.problem, no_update, no_update, next_]
            now.update({"solid": found.run} if level == 2 else {"run": found.run, "solid": None})
            now["number"] += 1
            ends = level == 2 or (level == 1 and not session.checks)
            return [found.told, "", drawn(x, y), now["number"], no_update if ends else values]

    if session is not None:
        keys = {"type": "key", "name": ALL}
        for level, source, to in (
            (0, Input(keys, "value"), "quick"),
            (1, Input("quick", "data"), "full"),
            (2, Input("full", "data"), "check"),
        ):
            answering(level, source, to)
        saving = (Output("saved", "children"), Input("save", "n_clicks"), State(keys, "value"))

        @app.callback(*saving, prevent_initial_call=True)
        def save(clicks: int, values: list[float]) -> str:
            try:
                return f"saved as {session.save(tuple(values))}"
            except DealibError as error:
                return str(error)

    @app.callback(Output("curves", "figure"), Input("x", "value"), Input("y", "value"))
    def curves(x: str, y: list[str]) -> Any:
        return drawn(x, y)

    moving = (Output("step", "max"), Output("step", "value"), Output("margins", "children"))
    told = (Input("shown", "data"), State("step", "value"), State("step", "max"))

    @app.callback(*moving, *told, prevent_initial_call=True)
    def shown(number: int, step: int, last: int) -> list[Any]:
        of: Any = now["run"]
        count = max(len(of.stored_steps) - 1, 1)
        stays = now.get("typical", _typical(run) / last) != step / last  # the user has chosen it
        now["typical"] = _typical(of) / count
        return [count, round(step / last * count) if stays else _typical(of), used(of)]

    chosen = [Input(name, "value") for name in ("step", "field", "cut", "share")]

    @app.callback(Output("device", "figure"), Input("shown", "data"), *chosen)
    def device(number: int | None, step: int, field: str, cut: str, share: float) -> Any:
        run, found = now["run"], dict[str, Any](data=[], layout={})
        try:
            with turn:
                steps = run.stored_steps or [-1]
                step = steps[min(int(step), len(steps) - 1)]
                found = drawing.device(run, step, field, cut, share)
        except DealibError as error:
            found["layout"]["title"] = {"text": str(error), "font": {"size": 12}}
        found["layout"]["meta"] = {"number": number or 1}
        return found

    return app


def _typical(run: Run) -> int:
    return run.stored_steps.index(typical_step(run)) if run.stored_steps else 0


def serve(app: Any, port: int) -> str:
    """Serve a page from a thread of its own.

    Args:
        app: The Dash application.
        port: Port of 127.0.0.1; 0: a free one.

    Returns:
        The address of the page.

    Raises:
        ConfigError: If the port is in use.
    """
    from flask import abort, request
    from werkzeug.serving import make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
        listening.listen()
    except OSError as error:
        hint = f"choose another one, or leave out {by_caller('--port', 'port')}"
        raise ConfigError(
            f"{by_caller('--port', 'port')} {port}: {error.strerror}; {hint}"
        ) from None

    @app.server.before_request
    def _for_this_machine() -> None:
        """Refuse other host names, by which web pages could reach this server (DNS rebinding)."""
        if request.host.partition(":")[0] not in (_HOST, "localhost"):
            abort(403)

    port = listening.getsockname()[1]
    server = make_server(_HOST, port, app.server, threaded=True, fd=listening.detach())
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://{_HOST}:{port}/"

"""The page: sliders, curves, margins and the deformed device; served to this machine alone."""

from __future__ import annotations

import logging
import socket
import threading
from typing import Any

from dealib.app import drawing
from dealib.app.drawing import RED, TOLD
from dealib.errors import ConfigError, DealibError, PlatformError
from dealib.plots.labels import label
from dealib.plots.shape import typical_step
from dealib.results.reader import Run
from dealib.results.summary import margins
from dealib.units import neat

_HOST = "127.0.0.1"
_SIDE = {"flex": "1 1 300px", "maxHeight": "94vh", "overflowY": "auto", "padding": "0 24px"}
_WIDE = {"flex": "2 1 420px", "minWidth": 0}
_ROW = {"display": "flex", "flexWrap": "wrap", "gap": "12px", "fontFamily": "sans-serif"}
_QUIET = {"displaylogo": False}


def build(run: Run, session: Any = None) -> Any:
    """The page of a run, or of a session, of which the run is the first answer.

    Raises:
        PlatformError: If dash is not installed.
    """
    try:
        from dash import ALL, Dash, Input, Output, State, dcc, html, no_update
    except ImportError:
        raise PlatformError(
            "dash is not installed, which shows pages: .venv/bin/pip install 'dash>=3,<5'"
        ) from None
    now: dict[str, Any] = {"run": run, "solid": None, "number": 1}  # what is shown
    turn = threading.Lock()
    every, x, y = drawing.columns(run)
    known, ways = drawing.fields(run), drawing.cuts(run)

    def slider(end: float, value: float, step: float, name: str) -> Any:
        return dcc.Slider(0, end, step, value=value, id=name, updatemode="drag", marks=None)

    def told_margins(of: Run) -> list[Any]:
        return [
            html.Div(
                f"{m.name} {m.used}",
                title=f"{m.meaning}; {m.when} {m.where}",
                style={} if m.ok else {"color": RED, "fontWeight": "bold"},
            )
            for m in margins(of)
        ]

    app = Dash(__name__, title=f"{run.title}: dealib", update_title="", serve_locally=True)
    controls: list[Any] = [html.H3(run.title)]
    for s in [] if session is None else session.sliders:
        name = {"type": "key", "name": s.key.name}
        ends = {end: neat(end, 3) for end in (s.low, s.high)}
        controls += [
            html.Label(f"{s.key.name} ({s.key.unit})" if s.key.unit else s.key.name),
            dcc.Slider(
                *(s.low, s.high, (s.high - s.low) / 100),
                **{"value": s.key.value, "id": name, "updatemode": "drag", "marks": ends},
            ),
        ]
    if session is not None:
        controls += [html.Button("Save as YAML", id="save"), html.Div(id="saved")]
    controls += [
        html.Div(run.status if session is None else "", id="status"),
        html.Div(id="problem", style={"color": RED}),
        html.Div(told_margins(run), id="margins"),
        *(dcc.Store(id=name) for name in ("shown", "quick", "full", "check")),
    ]
    names = [{"label": label(c), "value": c} for c in every]
    left = [
        dcc.Dropdown(names, x, id="x", clearable=False),
        dcc.Dropdown(names, y, id="y", multi=True),
        dcc.Graph(id="curves", style={"height": "84vh"}, config=_QUIET),
    ]
    right = [
        dcc.Dropdown(known, next(iter(known), None), id="field", clearable=False),
        dcc.Dropdown(ways, ways[0], id="cut", clearable=False),
        dcc.Graph(id="device", style={"height": "68vh"}, config=_QUIET),
        html.Label("stored state"),
        slider(max(len(run.stored_steps) - 1, 1), _typical(run), 1, "step"),
        html.Label("place of the cut, over the extent"),
        slider(1, 0.5, 0.02, "share"),
    ]
    parts = ((controls, _SIDE), (left, _WIDE), (right, _WIDE))
    app.layout = html.Div([html.Div(part, style=style) for part, style in parts], style=_ROW)

    def drawn(x: str, y: list[str]) -> Any:
        found = drawing.curves(now["run"], x, y or [], now["solid"])
        found["layout"]["meta"] = {"number": now["number"]}
        return found

    def answering(level: int, source: Any, to: str) -> None:
        outputs = [Output(n, "children", allow_duplicate=True) for n in ("status", "problem")]
        outputs += [
            Output("curves", "figure", allow_duplicate=True),
            *(Output("shown", "data", allow_duplicate=True), Output(to, "data")),
        ]

        at_once = True if level else "initial_duplicate"
        given = (source, State("x", "value"), State("y", "value"))

        @app.callback(*outputs, *given, prevent_initial_call=at_once)
        def answer(values: list[float], x: str, y: list[str]) -> list[Any]:
            found = session.ask(level, tuple(values))
            if found is None:
                return [no_update] * len(outputs)
            if found.problem:
                return [found.told, found.problem, no_update, no_update, values]
            solid = level == TOLD
            now.update({"solid": found.run} if solid else {"run": found.run, "solid": None})
            now["number"] += 1
            more = no_update if level == 1 and not session.checks else values
            return [found.told, "", drawn(x, y), now["number"], more]

    if session is not None:
        keys = {"type": "key", "name": ALL}
        answering(0, Input(keys, "value"), "quick")
        answering(1, Input("quick", "data"), "full")
        answering(TOLD, Input("full", "data"), "check")

        @app.callback(
            *(Output("saved", "children"), Input("save", "n_clicks"), State(keys, "value")),
            prevent_initial_call=True,
        )
        def save(clicks: int, values: list[float]) -> str:
            try:
                return f"saved as {session.save(tuple(values))}"
            except DealibError as error:
                return str(error)

    @app.callback(Output("curves", "figure"), Input("x", "value"), Input("y", "value"))
    def curves(x: str, y: list[str]) -> Any:
        return drawn(x, y)

    @app.callback(
        *(Output("step", "max"), Output("step", "value"), Output("margins", "children")),
        *(Input("shown", "data"), State("step", "value"), State("step", "max")),
        prevent_initial_call=True,
    )
    def shown(number: int, step: int, last: int) -> list[Any]:
        of: Any = now["run"]
        count = max(len(of.stored_steps) - 1, 1)
        same = now.get("typical", _typical(run)) == step / last
        now["typical"] = _typical(of) / count
        return [count, _typical(of) if same else round(step / last * count), told_margins(of)]

    @app.callback(
        Output("device", "figure"),
        *(Input("shown", "data"), Input("step", "value"), Input("field", "value")),
        *(Input("cut", "value"), Input("share", "value")),
    )
    def device(number: int, step: int, field: str, cut: str, share: float) -> Any:
        of: Any = now["run"]
        try:
            with turn:
                steps = of.stored_steps
                step = steps[min(int(step), len(steps) - 1)] if steps else -1
                found = drawing.device(of, step, field, cut, share)
        except DealibError as error:
            found = {"data": [], "layout": {"title": {"text": str(error), "font": {"size": 12}}}}
        found["layout"]["meta"] = {"number": number or 1}
        return found

    return app


def _typical(run: Run) -> int:
    return run.stored_steps.index(typical_step(run)) if run.stored_steps else 0


def serve(app: Any, port: int) -> str:
    """Serve a page from a thread of its own, at a port (0: a free one); returns its address.

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
        hint = "choose another one, or leave --port out"
        raise ConfigError(f"--port {port}: {error.strerror}; {hint}") from None

    @app.server.before_request
    def _for_this_machine() -> None:
        """Refuse a page of the web that has given this machine a name of its own."""
        if request.host.partition(":")[0] not in (_HOST, "localhost"):
            abort(403)

    port = listening.getsockname()[1]
    server = make_server(_HOST, port, app.server, threaded=True, fd=listening.detach())
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://{_HOST}:{port}/"

"""The page: sliders, curves, margins and the deformed device; served to this machine alone."""

from __future__ import annotations

import logging
import socket
import threading
from typing import Any

from dealib.app import drawing
from dealib.app.solving import CHECK, FULL, QUICK, Session
from dealib.errors import ConfigError, DealibError, PlatformError
from dealib.results.reader import Run
from dealib.units import neat

_HOST = "127.0.0.1"
_LEVELS = {QUICK: "quick: few steps and elements", FULL: "all steps", CHECK: "checked by the solid"}
_CONTROLS = {"minWidth": "300px", "flex": "1 1 300px", "maxHeight": "94vh", "overflowY": "auto"}


class _Shown:
    """What the page shows, and the one thread at a time that draws it."""

    def __init__(self, run: Run | None = None) -> None:
        self.run, self.solid, self.turn = run, None, threading.Lock()
        self.count = 0


def build(session: Session | None, run: Run | None, title: str) -> Any:
    """The page of a config under sliders, or of a run.

    Raises:
        PlatformError: If dash is not installed.
    """
    try:
        from dash import ALL, Dash, Input, Output, State, dcc, html, no_update
    except ImportError:
        raise PlatformError(
            "dash is not installed, which shows pages: .venv/bin/pip install 'dash>=3,<5'"
        ) from None
    shown = _Shown(run)
    app = Dash(__name__, title=f"{title}: dealib", update_title="", serve_locally=True)
    app.enable_dev_tools(debug=False)
    moved = [] if session is None else session.sliders
    controls: list[Any] = [html.H3(title)]
    for s in moved:
        unit = f" ({s.key.unit})" if s.key.unit else ""
        controls += [html.Label(f"{s.key.name}{unit}"),
                     dcc.Slider(s.low, s.high, (s.high - s.low) / 100, value=s.key.value,
                                id={"type": "key", "name": s.key.name}, updatemode="drag",
                                marks={e: neat(e, 4) for e in (s.low, s.high)},
                                tooltip={"placement": "bottom"})]  # fmt: skip
    if session is not None:
        controls += [html.Button("Save as YAML", id="save"), html.Div(id="saved")]
    controls += [html.Div(id="status"), html.Div(id="problem", style={"color": drawing.RED}),
                 html.Div(id="margins")]  # fmt: skip
    wide = {"flex": "2 1 420px", "height": "94vh"}
    app.layout = html.Div(
        [html.Div(controls, style=_CONTROLS),
         html.Div([dcc.Dropdown(id="x", placeholder="abscissa", clearable=False),
                   dcc.Dropdown(id="y", multi=True, placeholder="curves"),
                   dcc.Graph(id="curves", style={"height": "84vh"})], style=wide),
         html.Div([dcc.Dropdown(id="field", clearable=False),
                   dcc.Dropdown(id="cut", clearable=False),
                   dcc.Graph(id="device", style={"height": "68vh"}), html.Label("state"),
                   dcc.Slider(0, 1, 1, value=0, id="step", updatemode="drag", marks=None),
                   html.Label("where it is cut, of its extent"),
                   dcc.Slider(0, 1, 0.02, value=0.5, id="share", updatemode="drag", marks=None)],
                  style=wide),
         dcc.Store(id="shown"), dcc.Store(id="quick"), dcc.Store(id="full"), dcc.Store(id="start")],
        style={"display": "flex", "flexWrap": "wrap", "gap": "12px", "fontFamily": "sans-serif"})  # fmt: skip
    told = [Output(name, "children", allow_duplicate=True) for name in ("status", "problem")]
    told.append(Output("shown", "data", allow_duplicate=True))

    def answered(level: int, values: list[float]) -> list[Any]:
        """Ask the solver; what to tell and a new number if there is something new to draw."""
        assert session is not None
        found = session.ask(level, tuple(values))
        if found is None:
            return [no_update] * 3
        if level == CHECK:
            shown.solid = found.run if not found.problem else None
            return [_status(session, found), no_update, _next(shown)]
        shown.run, shown.solid = found.run, None
        return [_status(session, found), found.problem, _next(shown) if found.run else no_update]

    if session is not None:
        sliders = Input({"type": "key", "name": ALL}, "value")
        positions = State({"type": "key", "name": ALL}, "value")

        @app.callback(
            *told, Output("quick", "data"), sliders, prevent_initial_call="initial_duplicate"
        )
        def quick(values: list[float]) -> list[Any]:
            return [*answered(QUICK, values), values]

        @app.callback(
            *told, Output("full", "data"), Input("quick", "data"), prevent_initial_call=True
        )
        def full(values: list[float]) -> list[Any]:
            found = answered(FULL, values)
            return [*found, values if session.checks and found[2] is not no_update else no_update]

        @app.callback(*told, Input("full", "data"), prevent_initial_call=True)
        def check(values: list[float]) -> list[Any]:
            return answered(CHECK, values)

        @app.callback(Output("saved", "children"), Input("save", "n_clicks"), positions,
                      prevent_initial_call=True)  # fmt: skip
        def save(clicks: int, values: list[float]) -> str:
            try:
                return f"saved: {session.save(tuple(values))}"
            except DealibError as error:
                return str(error)

    else:

        @app.callback(*told, Input("start", "id"), prevent_initial_call="initial_duplicate")
        def start(_: Any) -> list[Any]:
            assert run is not None
            return [run.status, "", _next(shown)]

    @app.callback(
        *(Output(n, p) for n in ("x", "y", "field", "cut") for p in ("options", "value")),
        Output("step", "max"), Output("step", "value"), Output("margins", "children"),
        Input("shown", "data"), State("x", "value"), State("field", "value"), State("step", "value"),
        State("step", "max"), prevent_initial_call=True)  # fmt: skip
    def offered(_: Any, x: Any, field: Any, step: int, last: int) -> list[Any]:
        now = shown.run
        assert now is not None
        count = max(len(now.stored_steps) - 1, 1)
        uses = [html.Div(name, title=more, className="margin", style={} if ok else {"color": drawing.RED,
                         "fontWeight": "bold"}) for name, more, ok in drawing.uses(now)]  # fmt: skip
        step = round(step / last * count) if x else _typical(now)
        if x:
            return [no_update] * 8 + [count, step, uses]
        every, x, y = drawing.columns(now)
        with shown.turn:
            known = drawing.fields(now)
        options = [{"label": drawing.label(c), "value": c} for c in every]
        named = [{"label": text, "value": n} for n, text in known.items()]
        ways = drawing.cuts(now)
        return [
            options,
            x,
            options,
            y,
            named,
            next(iter(known), None),
            ways,
            ways[0],
            count,
            step,
            uses,
        ]

    @app.callback(Output("curves", "figure"), Input("shown", "data"), Input("x", "value"),
                  Input("y", "value"), prevent_initial_call=True)  # fmt: skip
    def curves(number: Any, x: str, y: list[str]) -> Any:
        if not x or not y or shown.run is None:
            return no_update
        found = drawing.curves(shown.run, x, y, shown.solid)
        found["layout"]["meta"] = {"number": number}
        return found

    @app.callback(Output("device", "figure"), Input("shown", "data"), Input("step", "value"),
                  Input("field", "value"), Input("cut", "value"), Input("share", "value"),
                  prevent_initial_call=True)  # fmt: skip
    def device(number: Any, step: int, field: str, cut: str, share: float) -> Any:
        now = shown.run
        if not field or now is None or not now.stored_steps:
            return no_update
        steps = now.stored_steps
        try:
            with shown.turn:
                found = drawing.device(
                    now, steps[min(int(step), len(steps) - 1)], field, cut, share
                )
        except DealibError as error:
            return {"data": [], "layout": {"title": {"text": str(error), "font": {"size": 12}}}}
        found["layout"]["meta"] = {"number": number}
        return found

    return app


def _next(shown: _Shown) -> int:
    shown.count += 1
    return shown.count


def _typical(run: Run) -> int:
    from dealib.plots.shape import typical_step

    return run.stored_steps.index(typical_step(run)) if run.stored_steps else 0


def _status(session: Session, answer: Any) -> str:
    model = "membrane" if session.membrane else f"solid ({session.why})" if session.why else "solid"
    if answer.problem:
        return f"{model}: the curves are those of an earlier position"
    off = f"; {answer.note}" if answer.note else ""
    return f"{model}, {_LEVELS[answer.level]}, {answer.seconds:.2f} s{off}"


def serve(app: Any, port: int) -> tuple[str, Any]:
    """Serve a page from a thread of its own.

    Args:
        app: The page.
        port: Port; 0 for a free one.

    Returns:
        Its address, and what shuts it down.

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
    except OSError as error:
        hint = "choose another one, or leave --port out"
        raise ConfigError(f"--port {port}: {error.strerror}; {hint}") from None
    listening.listen()

    @app.server.before_request  # type: ignore[untyped-decorator]
    def _for_this_machine() -> None:
        """Refuse a page of the web that has given this machine a name of its own."""
        if request.host.partition(":")[0] not in (_HOST, "localhost"):
            abort(403)

    port = listening.getsockname()[1]
    server = make_server(_HOST, port, app.server, threaded=True, fd=listening.fileno())
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://{_HOST}:{port}/", listening

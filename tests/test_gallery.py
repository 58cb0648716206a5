"""The gallery, configs/devices: each device against a solution without finite elements.

Bodies that are thick or strained alike everywhere have exact solutions. Films are compared with
the membrane, to which a solid tends linearly in its thickness: raw, and in that limit.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from io import StringIO
from itertools import pairwise
from runpy import run_path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from conftest import CONFIGS, case, history
from laminates import FILM, config, layer, rows
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, fsolve, minimize_scalar
from test_parallel import finish, start
from verification.references import (
    EPS0,
    annulus,
    balloon,
    capacitor,
    circle,
    cone,
    diaphragm,
    meridian,
    strip,
    tube,
    unimorph,
)
from verification.references.laws import Film, derivative, gent, neo_hooke

import dealib
from dealib.tasks.info import summary
from dealib.tasks.progress import Progress

Array = npt.NDArray[np.float64]

DEVICES = {
    "annulus_with_chamber", "balloon", "cone", "diaphragm_pump", "expanding_circle",
    "minimum_energy_structure",  # in test_minimum_energy.py
    "positioning_stage",  # in test_rigid_mount.py
    "pure_shear_strip", "segmented_annulus", "stack", "tube", "unimorph_bender",
    "wrinkling_film",  # in test_stability.py
}  # fmt: skip
EPS = 4.7 * EPS0  # N/kV^2
SOFT = neo_hooke(0.02)  # of most devices
STIFF = neo_hooke(1 / 3)  # E = 1 MPa
PRESTRAIN = "{stage: prestrain, steps: 2}"


def incompressible(prestretch: float) -> dict[str, str]:
    """Changes to a film of E = 1 MPa, as the references are: kappa = 50/3 E is not enough."""
    film = {
        "law": "neo_hookean", "shear_modulus": f"{1 / 3!r} MPa", "bulk_modulus": "3 GPa",
        "relative_permittivity": 3.0, "prestretch": prestretch,
    }  # fmt: skip
    given = ", ".join(f"{key}: {value}" for key, value in film.items())
    return {"materials__film": f"{{{given}}}", "physics__formulation": "mixed"}


def end(h: pd.DataFrame, stage: str) -> Any:
    """The last row of a stage."""
    return h[h["stage"] == stage].iloc[-1]


def check_thin(
    measure: Callable[[float], list[float]], exact: list[float], raw: float, limit: float
) -> None:
    """Compare a device at twice, once and half its thickness with the membrane.

    Args:
        measure: What is measured, by the share of the shipped thickness, at the same membrane.
        exact: The membrane's.
        raw: Relative tolerance at the shipped thickness.
        limit: The same of the limit without thickness.
    """
    thick, middle, thin = (np.array(measure(f)) for f in (2.0, 1.0, 0.5))
    assert middle == pytest.approx(exact, rel=raw)
    # on a line, within a tenth of their change
    assert (np.abs(thick - 3 * middle + 2 * thin) < 0.1 * np.abs(thick - thin)).all()
    assert 2 * thin - middle == pytest.approx(exact, rel=limit)


@pytest.mark.once
def test_the_gallery_is_complete_and_says_where_its_devices_are_used():
    paths = sorted((CONFIGS / "devices").glob("*.yaml"))
    assert {path.stem for path in paths} == DEVICES
    for path in paths:
        head = " ".join(x[1:].strip() for x in path.read_text().splitlines() if x[:1] == "#")
        assert "Used " in head, path
        assert dealib.load(path).config.name == path.stem


# --- films ---------------------------------------------------------------------------------------


@pytest.mark.once
def test_expanding_circle():
    def edge(f: float) -> list[float]:
        volts = f"{5.48065 * f!r} kV"
        h = history(
            "devices/expanding_circle",
            geometry__layers__0__thickness=f"{0.5 * f} mm",
            program__1__terminal__voltage=volts,
        )
        return [h["edge_mm"].iloc[-1]]

    state = circle.at_voltage(circle.Circle(Film(SOFT, 0.5, 1.5, EPS), 50.0, 25.0), 5.48065)
    assert state is not None
    assert state.edge / 25 == pytest.approx(1.037061, abs=1e-6)
    check_thin(edge, [state.edge - 25], 0.02, 3e-3)
    centre = history("devices/expanding_circle")["centre"].iloc[-1]
    assert centre - 1.5 == pytest.approx(state.stretch - 1.5, rel=1e-3)


@pytest.mark.once
def test_diaphragm_pump():
    """Open at a pressure, and closed at a volume, each under voltage."""

    def states(f: float) -> list[float]:
        volts = f"terminal: {{voltage: {2.19226 * f!r} kV}}"
        h = history(
            "devices/diaphragm_pump",
            geometry__layers__0__thickness=f"{0.25 * f} mm",
            program=f"[{PRESTRAIN}, {{stage: open, chamber: {{pressure: {250 * f} Pa}}, steps: 5}},"
            f"{{stage: on, {volts}, steps: 3}}, {{stage: closed, chamber: {{volume: 3.2 ml}}}}]",
        )
        on, closed = end(h, "on"), end(h, "closed")
        return [on["apex_mm"], on["volume_mm3"], closed["apex_mm"], closed["pressure_kPa"] / f]

    device = diaphragm.Diaphragm(Film(SOFT, 0.25, 1.2, EPS), 20.0)
    state = diaphragm.at_pressure(device, 250e-6, 2.19226)
    assert state is not None
    assert (state.height / 20, state.volume / 8000) == pytest.approx((0.297539, 0.485533), rel=3e-6)

    def excess(pressure: float) -> float:
        found = diaphragm.at_pressure(device, pressure, 2.19226)
        assert found is not None
        return found.volume - 3200.0

    closed = diaphragm.at_pressure(device, brentq(excess, 1.5e-4, 2.5e-4), 2.19226)
    assert closed is not None
    exact = [state.height, state.volume, closed.height, 1e3 * closed.pressure]
    check_thin(states, exact, 0.03, 3e-3)


def _inflated(film: Film, a: float, b: float, pressure: float, voltage: float) -> Array:
    """Annulus whose free rigid disc bears the pressure too: rise, volume, capacitance (nF)."""
    lp = film.prestretch

    def run(radial: float) -> meridian.Meridian:
        return meridian.integrate(
            film, (a / lp, b / lp), (a, 0.0, radial), lp, voltage=voltage, pressure=pressure
        )

    flat = a / lp * float(film.stress(lp, lp, voltage))
    found = run(brentq(lambda n: run(n).r[-1] - b, 0.5 * flat, 3 * flat, xtol=1e-14))
    return np.array([-found.z[-1], found.volume, found.capacitance])


@pytest.mark.once
def test_annulus_with_chamber():
    """On a chamber at a pressure; and on closed gas, p V constant from its state at rest."""

    def states(f: float) -> list[float]:
        h = history(
            "devices/annulus_with_chamber", **incompressible(1.15),
            geometry__layers__0__thickness=f"{0.04 * f} mm",
            program=f"[{PRESTRAIN}, {{stage: release, mount: {{force: 0 N}}}}, {{stage: inflate, "
            f"chamber: {{pressure: {0.22 * f!r} kPa}}, steps: 6}}, {{stage: actuate, "
            f"terminal: {{voltage: {2 * f} kV}}, steps: 4}}]",
        )  # fmt: skip
        row = h.iloc[-1]
        return [row["displacement_mm"], row["volume_mm3"], row["capacitance_pF"] * f]

    rise, volume, C = _inflated(Film(STIFF, 0.04, 1.15, 3 * EPS0), 6.0, 12.0, 0.22e-3, 2.0)
    check_thin(states, [rise, volume, 1e3 * C], 0.01, 1e-3)
    h = history("devices/annulus_with_chamber")
    closed = h[h["stage"] == "actuate"]
    gas = (closed["pressure_kPa"] + 101.325) * (5000 + closed["volume_mm3"])
    assert gas.to_numpy() == pytest.approx(105 * 5000, rel=1e-9)
    assert (np.diff(closed["volume_mm3"]) != 0).all()


@pytest.mark.once
def test_segmented_annulus():
    """Both parts' capacitances as it is pushed, and the voltage that tells the motion."""
    parts = {"drive": (8.0, 13.0), "sense": (14.0, 20.0)}

    def states(f: float) -> list[float]:
        h = history(
            "devices/segmented_annulus", **incompressible(1.2),
            geometry__layers__0__thickness=f"{0.05 * f} mm",
            program=f"[{PRESTRAIN}, {{stage: push, mount: {{displacement: -3 mm}}, steps: 6}}]",
        )  # fmt: skip
        row = h.iloc[-1]
        return [-row["force_N"] / f, *(row[f"capacitance_pF.{p}.{p}"] * f for p in parts)]

    film = Film(STIFF, 0.05, 1.2, 3 * EPS0)
    state = annulus.push(annulus.Annulus(film, 8.0, 20.0), 3.0)
    m = state.meridian
    area = CubicSpline(m.R, 2 * np.pi * m.R * (m.l1 * m.l2) ** 2).antiderivative()
    exact = [
        1e3 * film.permittivity / film.unstretched * float(area(b / 1.2) - area(a / 1.2))
        for a, b in parts.values()
    ]
    check_thin(states, [state.force, *exact], 0.01, 1e-3)
    h = history("devices/segmented_annulus")
    # flat; within the film the field reaches 2 ln 2/pi of the thickness beyond an electrode's edge
    reach, edge = 2 * np.log(2) / np.pi * 0.05, {"drive": 13.0, "sense": 14.0}
    areas = [np.pi * (b**2 - a**2 + 2 * edge[p] * reach) for p, (a, b) in parts.items()]
    flat = [1e3 * EPS0 * 3 * area / 0.05 for area in areas]
    C = h[[f"capacitance_pF.{p}.{p}" for p in parts]].to_numpy()
    assert C[0] == pytest.approx(flat, rel=1e-3)
    isolated = h[h["stage"] == "isolate"]
    V = isolated[[f"voltage_kV.{p}" for p in parts]].to_numpy()
    matrix = isolated[[f"capacitance_pF.sense.{p}" for p in parts]].to_numpy()
    assert 1e-3 * (matrix * V).sum(axis=1) == pytest.approx(isolated["charge_uC.sense"], rel=1e-9)


@pytest.mark.once
def test_cone(tmp_path):
    """Preformed: no other reference has a film that is free of stress out of its plane."""
    draw = run_path(str(CONFIGS.parent / "meshes" / "make.py"))

    def states(f: float) -> list[float]:
        file = draw["write"](tmp_path / f"{f}.msh", partial(draw["cone"], thickness=0.05 * f))
        h = history(
            "devices/cone",
            geometry__file=str(file),
            program__0__mount__force=f"{0.2 * f!r} N",
            program__1__terminal__voltage=f"{1.5 * f!r} kV",
        )
        rows = [end(h, "load"), end(h, "actuate")]
        return [r[c] * k for r in rows for c, k in (("displacement_mm", 1), ("capacitance_pF", f))]

    film = Film(neo_hooke(0.2), 0.05, 1.0, 2.8 * EPS0)
    device = cone.Cone(film, 5.0, 15.0, 6.0)
    found = [cone.pull(device, 0.2, V) for V in (0.0, 1.5)]
    exact = [x for s in found for x in (s.displacement, 1e3 * s.capacitance)]
    check_thin(states, exact, 5e-3, 3e-4)


@pytest.mark.once
def test_the_cones_reference_obeys_its_potential():
    """-dPi/dV = Q and -dPi/dF = u, Pi = energy - C V^2/2 - F u."""
    device = cone.Cone(Film(neo_hooke(0.2), 0.05, 1.0, 2.8 * EPS0), 5.0, 15.0, 6.0)

    def potential(force: float, voltage: float) -> float:
        state = cone.pull(device, force, voltage)
        return state.energy - state.capacitance * voltage**2 / 2 - force * state.displacement

    at = cone.pull(device, 0.2, 1.0)
    assert -derivative(partial(potential, 0.2), 1.0, 0.05) == pytest.approx(at.capacitance)
    by_force = derivative(lambda force: potential(force, 1.0), 0.2, 0.01)
    assert -by_force == pytest.approx(at.displacement)


# --- thick bodies --------------------------------------------------------------------------------


def test_tube():
    """Free; and held with a pressure in its bore, whose caps the mount carries."""

    def found(kappa: int) -> Array:
        h = history("devices/tube", materials__film__bulk_modulus=f"{kappa} MPa")
        length = 10 + h["displacement_mm"]
        inner = ((h["volume_mm3"] / np.pi + 10**2 * 10) / length) ** 0.5
        wall = h["force_N"] + np.pi * inner**2 * 1e-3 * h["pressure_kPa"]
        C = h["capacitance_pF"]
        return np.array([length / 10 - 1, inner - 10, C / C[0] - 1, wall]).T[h["voltage_kV"] > 0.1]

    given = tube.Tube(SOFT, 10.0, 11.0, EPS)
    h = history("devices/tube")
    exact = []
    for _, row in h[h["voltage_kV"] > 0.1].iterrows():
        ends = "held" if row["stage"] == "actuate held" else "open"
        state = tube.at_voltage(given, row["voltage_kV"], 1e-3 * row["pressure_kPa"], ends)
        assert state is not None
        C = state.capacitance / tube.at_voltage(given, 0.0).capacitance
        exact.append((state.stretch - 1, state.inner - 10, C - 1, state.force))
    assert len(exact) == 9
    raw, fine = found(200), found(400)
    assert raw[:, :3] == pytest.approx(np.array(exact)[:, :3], rel=1e-4, abs=1e-9)
    limit = 2 * fine - raw  # without compressibility
    for k, size in enumerate((1.0, 1.0, 1.0, 0.1)):
        column = np.array(exact)[:, k]
        assert limit[:, k] == pytest.approx(column, rel=1e-5, abs=1e-6 * size), k


def test_balloon():
    """Past its largest pressure, and less pressure under voltage at the same volume."""
    h = history("devices/balloon")
    given = balloon.Balloon(gent(0.02, 30.0), 10.0, 2.0, EPS, thick=True)
    stretch = (1 + 2 * h["volume_mm3"] / balloon.volume(given, 1.0)).to_numpy() ** (1 / 3)
    assert stretch[-1] == pytest.approx(2.0)
    pairs = list(zip(stretch, h["voltage_kV"], strict=True))
    exact = [1e3 * balloon.pressure(given, *pair) for pair in pairs]
    assert h["pressure_kPa"].to_numpy() == pytest.approx(exact, rel=1e-4, abs=1e-9)
    C = [2e-3 * value for value in h["capacitance_pF"]]
    assert pytest.approx([balloon.capacitance(given, x) for x, _ in pairs], rel=1e-4) == C
    # the largest pressure, of the curve through the states
    inflated = h["voltage_kV"] == 0
    curve = CubicSpline(stretch[inflated], h["pressure_kPa"][inflated])
    peak = minimize_scalar(lambda x: -curve(x), bounds=(1.3, 1.8), method="bounded").x
    limit = balloon.limit_pressures(given)[0]
    assert limit == pytest.approx(1.545012, abs=1e-6)
    assert peak == pytest.approx(limit, rel=1e-2)
    assert curve(peak) == pytest.approx(1e3 * balloon.pressure(given, limit), rel=1e-4)


# --- alike everywhere, or along the length -------------------------------------------------------


@pytest.mark.once
def test_pure_shear_strip():
    """Exact but for its compressibility, whose effect is a power series in 1/kappa."""
    H0, W0, load = 0.222222 * 1.5**2, 100 / 1.5, 0.912209
    given = strip.Strip(SOFT, H0, W0, 1.5, EPS)
    states = [strip.at_load(given, load / (H0 * W0), V) for V in (0.0, 4.38452)]
    assert states[1].stretch == pytest.approx(2.202946, abs=1e-5)

    def found(kappa: int) -> Array:
        h = history("devices/pure_shear_strip", materials__film__bulk_modulus=f"{kappa} GPa")
        rows = [end(h, "load"), end(h, "actuate")]
        values = [(1.5 * (1 + r["displacement_mm"] / 30), r["capacitance_pF"]) for r in rows]
        return np.array(values)

    raw = [found(kappa) for kappa in (1, 2, 4)]
    exact = np.array([(s.stretch, 1e3 * s.capacitance * 30 / 1.5) for s in states])
    assert raw[-1] == pytest.approx(exact, rel=1e-4)
    once = [2 * fine - coarse for coarse, fine in pairwise(raw)]
    assert (4 * once[1] - once[0]) / 3 == pytest.approx(exact, rel=1e-8)


def test_unimorph_bender():
    """Curvature and stretch of the interface at mid-length; deflection at a small voltage."""
    places = [6, 10, 14]
    probes = ", ".join(
        f"{axis}{x}: {{displacement: {axis}, at: [{x} mm, 0 mm]}}" for axis in "XZ" for x in places
    )
    middle = "middle: {quantity: stretch_X, at: [10 mm, 0 mm]}, tip: {displacement: Z, at: [20 mm, "
    h = history("devices/unimorph_bender", probes=f"{{{probes}, {middle}0 mm]}}}}")
    given = unimorph.Unimorph(SOFT, SOFT, 0.5, 0.5, EPS)
    exact = unimorph.bend(given, 3.28839)
    assert exact.k == pytest.approx(0.0357664, rel=1e-5)
    row = h.iloc[-1]
    a, b, c = (np.array([x + row[f"X{x}_mm"], row[f"Z{x}_mm"]]) for x in places)
    sides = [float(np.linalg.norm(q - p)) for p, q in ((a, b), (b, c), (c, a))]
    area = abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) / 2
    assert 4 * area / np.prod(sides) == pytest.approx(exact.curvature, rel=1e-4)
    assert row["middle"] == pytest.approx(exact.stretch, rel=1e-4)
    assert row["capacitance_pF"] == pytest.approx(1e3 * exact.capacitance * 200, rel=5e-4)
    small = h.iloc[1]  # w = kappa L^2/2, less what the clamp takes of the first 1 mm or so
    bent = unimorph.curvature(given, small["voltage_kV"]) * 20**2 / 2
    assert -small["tip_mm"] == pytest.approx(bent, rel=0.01)


def _stack(voltage: float, blocked: bool, held: bool) -> tuple[float, float]:
    """Stroke (mm) and force (N) of the stack, whose layers are each strained alike everywhere.

    They share the stretch l in their plane; z are those across films and electrodes. A film's
    potential a unit of volume is W - eps (V/H)^2 l^2/(2 z), that of an electrode W, with the law of
    the config, W = G/2 ((2 l^2 + z^2) J^(-2/3) - 3) + kappa/2 (J - 1)^2, J = l^2 z. The stress in
    the plane vanishes on the average only, so that the free edge is disturbed; it is not if the
    rim is held.
    """
    films, electrodes, H = 10 * 0.05, 11 * 0.002, 0.05
    area, pull = np.pi * 5**2, 3 * EPS0 * (voltage / H) ** 2

    def law(modulus: float, l: Any, z: Any) -> Any:
        J = l * l * z
        shear = modulus / 6 * ((2 * l * l + z * z) * J ** (-2 / 3) - 3)
        return shear + 50 / 6 * modulus * (J - 1) ** 2

    def potential(x: Any) -> Any:
        l, z, thin = x
        soft = law(1.0, l, z) - pull * l * l / (2 * z)
        return films * soft + electrodes * law(0.1, l, thin)

    def slopes(x: Array) -> Array:
        steps = np.eye(3) * 1e-30j
        return np.array([potential(x + s).imag / 1e-30 for s in steps])

    def stroke(x: Array) -> float:
        return float(films * (x[1] - 1) + electrodes * (x[2] - 1))

    def miss(x: Array) -> list[float]:
        by_l, by_z, by_thin = slopes(x)
        across = [by_z, by_thin]
        if blocked:
            across = [by_z / films - by_thin / electrodes, stroke(x)]
        return [x[0] - 1 if held else by_l, *across]

    x = fsolve(miss, np.ones(3), xtol=1e-12)
    assert np.abs(miss(x)).max() < 1e-12
    return stroke(x), float(area * slopes(x)[1] / films)


def test_stack():
    rim = {"holds": "[{on: base.bottom, fix: Z}, {on: outer, fix: R}]"}
    for held, changes, accuracy in ((True, rim, (1e-8, 1e-8)), (False, {}, (1e-5, 1e-4))):
        h = history("devices/stack", **changes)
        for stage, blocked in (("actuate", False), ("actuate blocked", True)):
            row = end(h, stage)
            stroke, force = _stack(2.0, blocked, held)
            assert row["displacement_mm"] == pytest.approx(stroke, rel=accuracy[0], abs=1e-12)
            assert row["force_N"] == pytest.approx(force, rel=accuracy[1], abs=1e-9)
        flat = 10 * 3 * EPS0 * np.pi * 5**2 / 0.05 * 1e3
        assert h["capacitance_pF"].iloc[0] == pytest.approx(flat, rel=1e-9)


@pytest.mark.once
@pytest.mark.parametrize(
    ("width", "er", "mesh", "excess"),
    [
        (10, 1.0, (60, 8), 0.16),  # the homogeneous medium of Love
        (10, 4.7, (60, 8), 0.07),
        (1, 4.7, (160, 24), 0.5),
    ],
)
def test_a_plane_capacitor_has_a_fringe_field(width, er, mesh, excess):
    """Two strips on a sheet of 1 mm in air, far from its ends; excess: over the parallel plates."""
    length = 6 * width if width > 1 else 20
    within = [f"{length / 2 + side * width / 2} mm" for side in (-1, 1)]
    faces = {"hot": "film.top", "ground": "film.bottom"}
    given = config(
        "strip",
        layer(thickness="1 mm"),
        geometry={
            "base": {"kind": "strip", "length": f"{length} mm", "width": "10 mm"},
            "air_height": f"{length / 2} mm",
        },
        materials={"film": FILM | {"relative_permittivity": er}},
        mesh=dict(zip(("columns", "film_rows"), mesh, strict=True)),
        holds=[{"on": ["film.bottom", "film.top"], "fix": ["X", "Z"]}],
        terminals={
            name: {"on": face, "within": within, "ground": name == "ground"}
            for name, face in faces.items()
        },
    )
    C = rows(given)[0]["capacitance_pF"]
    exact = 1e3 * EPS0 * 10 * capacitor.infinite_sheet(width, 1.0, er)
    assert pytest.approx(exact, rel=5e-3) == C
    assert exact > (1 + excess) * 1e3 * EPS0 * 10 * er * width


@pytest.mark.once
def test_the_meshes_are_what_their_script_writes(tmp_path):
    draw = run_path(str(CONFIGS.parent / "meshes" / "make.py"))
    for name in ("balloon", "cone"):
        text = draw["write"](tmp_path / f"{name}.msh", draw[name]).read_text()
        assert text == (CONFIGS.parent / "meshes" / f"{name}.msh").read_text()
        assert case(f"devices/{name}").config.device.laminate is None


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("name", sorted(DEVICES))
def test_two_ranks_give_the_same_history(name, tmp_path):
    """To 1e-9 of the largest value of a column and of those of other components and ports.

    Where a force is kept at zero, and where symmetry lets nothing turn, of its rounding. A film at
    its buckling load and a soft frame give way to what their residuals leave: the film is solved to
    a tenth of it, the frame, for which this is below rounding, is equal to 1e-7 (1.3e-8 measured).
    """
    config_file = CONFIGS / "devices" / f"{name}.yaml"
    tight = {"solver__tolerance": 1e-10} if name == "wrinkling_film" else {}
    more = [f"--set={key.replace('__', '.')}={value}" for key, value in tight.items()]
    to_file = ["--out", tmp_path / "run", *more]
    code, errors = finish(start(2, "-m", "dealib", "run", config_file, *to_file))
    assert code == 0, errors
    one, run = history(f"devices/{name}", **tight), dealib.open(tmp_path / "run")
    equal = 1e-7 if name == "minimum_energy_structure" else 1e-9
    assert run.info["ranks"] == 2
    other = run.history
    assert list(one) == list(other)
    assert one["stage"].tolist() == other["stage"].tolist()
    for column in one.columns.drop(["stage", "newton_iterations"]):
        zero = column.startswith(("force_N", "rotation_deg")) or column.endswith("_mJ")
        least = 1e-3 if zero else 1e-6
        alike = [c for c in one if c.partition(".")[0] == column.partition(".")[0]]
        size = max(one[alike].abs().max().max(), least)
        assert other[column].to_numpy() == pytest.approx(one[column], abs=equal * size), column


@pytest.mark.once
def test_info_says_what_voltage_does_to_a_chamber(tmp_path):
    """At a constant pressure its volume grows, at a constant volume its pressure falls."""
    run = dealib.simulate(case("devices/diaphragm_pump"), tmp_path / "run")
    h, text = run.history, summary(run)
    open_, closed = (h[h["stage"] == s] for s in ("actuate", "actuate closed"))
    grown = open_["volume_mm3"].max() - end(h, "inflate")["volume_mm3"]
    fallen = end(h, "close")["pressure_kPa"] - closed["pressure_kPa"].min()
    wanted = f"{grown:.5g} mm3 at up to 2.192 kV (pressure constant)"
    assert f"volume change in 'actuate'           {wanted}" in text
    assert f"pressure change in 'actuate closed'  {fallen:.5g} kPa at up to 2.192 kV\n" in text
    assert "held" not in text


class Terminal(StringIO):
    def isatty(self):
        return True


@pytest.mark.once
def test_the_bar_on_a_terminal_shows_the_ports_that_there_are(monkeypatch):
    shown = Terminal()
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    bar = Progress()
    run = dealib.Simulation(case("devices/balloon", program="[{stage: rest}]"))
    bar.start(run)
    for state in run:
        bar.see(state)
    bar.stop(None)
    assert "rest  V 0.0000 kV  p 0.0000 kPa" in shown.getvalue()

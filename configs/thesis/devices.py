"""The quantities behind the thesis's windows, by the membrane or by the finite-element model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from membrane import Coupling, Layer, Membrane

from dealib.units import EPSILON_0, GRAVITY

VOLTS = 2.5  # kV, the largest
MASSES = (5.0, 10.0, 15.0, 20.0, 28.0)  # g, Fig. 31
MODULI = {"nh": (1.0, 3.0), "mr": (1.25, 2.0)}  # MPa, film and electrodes as the thesis chose
CONFIG = Path(__file__).parent.parent / "deap100.yaml"


@dataclass(frozen=True)
class Parameters:
    """What the thesis does not publish; mm and N."""

    film_thickness: float = 0.030
    prestretch: float = 1.15
    permittivity: float = 3.0
    inner_75: float = 5.8
    outer_75: float = 9.5
    inner_100: float = 8.35
    outer_100: float = 12.35
    inner_200: float = 16.8
    outer_200: float = 25.4
    preload_12: float = 0.15
    preload_23: float = 0.35
    preload_36: float = 0.06
    displacement_35: float = 1.3

    def vector(self) -> list[float]:
        """The values, in order."""
        return list(asdict(self).values())

    @classmethod
    def names(cls) -> list[str]:
        """Their names, in order."""
        return list(cls.__dataclass_fields__)


@dataclass(frozen=True)
class Device:
    """One simulated device: all that its states depend on, so that they can be cached."""

    inner: float
    outer: float
    film_thickness: float
    prestretch: float
    permittivity: float
    law: str
    film_modulus: float
    electrode_thickness: float  # 0: the film alone

    @classmethod
    def of(
        cls,
        p: Parameters,
        size: int = 100,
        law: str = "nh",
        film_modulus: float | None = None,
        electrode_thickness: float = 0.010,
    ) -> Device:
        """The device of a size, with the thesis's moduli unless another is given."""
        return cls(
            inner=getattr(p, f"inner_{size}"),
            outer=getattr(p, f"outer_{size}"),
            film_thickness=p.film_thickness,
            prestretch=p.prestretch,
            permittivity=p.permittivity if electrode_thickness else 3.0,
            law=law,
            film_modulus=film_modulus or MODULI[law][0],
            electrode_thickness=electrode_thickness,
        )


@dataclass(frozen=True)
class Target:
    """A state to reach: the mount's displacement (mm) or force (N), downwards, and a voltage."""

    u: float | None = None
    F: float | None = None
    V: float = 0.0


@dataclass(frozen=True)
class Reached:
    """A state that was reached: positive downwards; mm, N, pF, C/m^2, MPa."""

    u: float
    F: float
    C: float
    charge_density: float
    radial_stress: float
    electrode_stress: float = 0.0


Solver = Callable[[Device, Sequence[Target]], list[Reached]]


def cached(solve: Solver) -> Solver:
    """The same solver, remembering: most parameters touch few of the devices."""
    known: dict[tuple[Device, tuple[Target, ...]], list[Reached]] = {}

    def remember(device: Device, targets: Sequence[Target]) -> list[Reached]:
        key = (device, tuple(targets))
        if key not in known:
            known[key] = solve(device, targets)
        return known[key]

    return remember


def by_membrane(coupling: Coupling = "energy") -> Solver:
    """A solver by the thin-membrane model."""

    def solve(device: Device, targets: Sequence[Target]) -> list[Reached]:
        d, te = device, 2 * device.electrode_thickness
        model = Membrane(
            d.inner,
            d.outer,
            Layer.of(d.law, d.film_modulus, d.film_thickness, d.prestretch),
            Layer.of(d.law, MODULI[d.law][1], te) if te else None,
            d.permittivity,
            coupling,
            elements=8,
        )
        out, u, F, V = [], 0.0, 0.0, 0.0
        for t in targets:
            if t.F is not None and u == 0:
                model.solve(V, 0.3)  # a flat film: start from a bulge
            now, step = 0.0, 1.0
            while now < 1:
                step = min(step, 1 - now)
                s, kept = now + step, (model.q.copy(), [z.copy() for z in model.logs])
                at = {"displacement": u + s * (t.u - u)} if t.u is not None else {}
                if t.F is not None:
                    at = {"force": F + s * (t.F - F)}
                try:
                    model.solve(V + s * (t.V - V), **at)
                    now = s
                except ArithmeticError:
                    model.q, model.logs = kept
                    step /= 2
                    if step < 1 / 64:
                        raise
            u, V = float(model.q[0, 1]), t.V
            F = float(model.residual(V)[0][0, 1])
            sigma = model.charge_density(V) if V else 0.0
            stresses = [model.radial_stress(k) for k in range(len(model.layers))]
            out.append(Reached(u, F, model.capacitance(), sigma, *stresses))
        return out

    return cached(solve)


def by_finite_elements(device: Device, targets: Sequence[Target]) -> list[Reached]:
    """The same by dealib without air: 20 x 2 film cells, 0.1 % off the mesh of the configs."""
    import dealib

    d, law = device, {"nh": "neo_hookean", "mr": "mooney_rivlin"}[device.law]
    program = ["{stage: prestrain}"]
    for k, t in enumerate(targets):
        mount = f"displacement: {-t.u!r} mm" if t.u is not None else f"force: {-(t.F or 0)!r} N"
        steps = 3 if k == 0 or t.V != targets[k - 1].V else 2
        program.append(
            f"{{stage: s{k}, steps: {steps}, mount: {{{mount}}}, terminal: {{voltage: {t.V} kV}}}}"
        )
    case = dealib.load(
        CONFIG,
        set={
            "geometry.inner_radius": f"{d.inner} mm",
            "geometry.outer_radius": f"{d.outer} mm",
            "geometry.film_thickness": f"{d.film_thickness} mm",
            "geometry.electrode_thickness": f"{d.electrode_thickness} mm",
            "geometry.air_height": "0 mm",
            "mesh.columns": 20,
            "mesh.film_rows": 2,
            "materials.film": f"{{law: {law}, youngs_modulus: {d.film_modulus} MPa, "
            f"relative_permittivity: {d.permittivity}, prestretch: {d.prestretch}}}",
            "materials.electrode": f"{{law: {law}, youngs_modulus: {MODULI[d.law][1]} MPa}}",
            "program": f"[{', '.join(program)}]",
        },
    )
    from dealib.results.fields import fields

    out = []
    for state in dealib.Simulation(case):
        if not state.end_of_stage or state.row["stage"] == "prestrain":
            continue
        row, mesh = state.row, state.simulation.layout.mesh
        found = fields(case.config, mesh, state.nodal())
        share = (mesh.points[:, 0] - d.inner) / (d.outer - d.inner)

        def middle(region: str) -> Any:
            nodes = np.unique(mesh.cells[mesh.in_region(region)])
            return nodes[np.abs(share[nodes] - 0.5) < 0.1]

        def stress(region: str) -> float:
            return float(found["second_pk_stress"][middle(region), 0, 0].mean())

        out.append(
            Reached(
                u=-row["displacement_mm"],
                F=-row["force_N"],
                C=row["capacitance_pF"],
                charge_density=float(np.linalg.norm(found["D"][middle("film")], axis=1).mean()),
                radial_stress=stress("film"),
                electrode_stress=stress("top_electrode") if d.electrode_thickness else 0.0,
            )
        )
    return out


def quantities(p: Parameters, solve: Solver) -> dict[str, float]:
    """Every quantity that a window asks for."""
    q: dict[str, float] = {
        "outer_75": p.outer_75,
        "outer_100": p.outer_100,
        "outer_200": p.outer_200,
        "length_100": p.outer_100 - p.inner_100,
        "length_200": p.outer_200 - p.inner_200,
        "film_um": 1e3 * p.film_thickness,
        "permittivity": p.permittivity,
        "preload23_N": p.preload_23,
    }
    push = [Target(u=1.0), Target(u=2.0), Target(u=3.0)]
    alone = {
        law: solve(Device.of(p, law=law, electrode_thickness=0.0), push) for law in ("nh", "mr")
    }
    q["film_nh1_F3"] = alone["nh"][-1].F
    q["film_nh15_F3"] = 1.5 * q["film_nh1_F3"]  # all of the film's moduli in proportion to E
    q["film_mr15_F3"] = 1.5 / 1.25 * alone["mr"][-1].F
    for mm in (1, 2, 3):
        q[f"film_ratio_{mm}"] = alone["mr"][mm - 1].F / alone["nh"][mm - 1].F
    charges, stresses = {}, {}
    for size, law in ((100, "nh"), (100, "mr"), (75, "nh"), (75, "mr"), (200, "nh")):
        tag = law if size == 100 else f"{law}{size}"
        path = [Target(u=0.001), Target(u=1), Target(u=2), Target(u=2, V=VOLTS), Target(u=2)]
        path += [Target(u=2.5), Target(u=3)]
        if tag == "nh75":
            path += [Target(u=p.displacement_35), Target(u=p.displacement_35, V=VOLTS)]
        rest, _, held, driven, _, more, last, *other = solve(Device.of(p, size, law), path)
        q[f"{tag}_F2"], q[f"{tag}_F3"] = held.F, last.F
        q[f"{tag}_blocking"] = held.F - driven.F
        if other:
            q[f"{tag}_blocking_35"] = other[0].F - other[1].F
        if law == "nh":
            q[f"C{size}_0"], q[f"C{size}_25"] = rest.C, more.C
            q[f"charge_{size}"] = charges[size] = driven.charge_density
            stresses[size] = held.radial_stress
        if tag == "nh":
            q["stress_ratio"] = held.electrode_stress / held.radial_stress
    for mm in (2, 3):
        q[f"ratio_{mm}"] = q[f"mr_F{mm}"] / q[f"nh_F{mm}"]
        q[f"ratio_75_{mm}"] = q[f"mr75_F{mm}"] / q[f"nh75_F{mm}"]
    q["charge_spread"] = max(charges.values()) / min(charges.values()) - 1
    q["field"] = charges[100] / (EPSILON_0 * p.permittivity)
    q["S_100_75"], q["S_200_100"] = stresses[100] / stresses[75], stresses[200] / stresses[100]
    for law in ("nh", "mr"):
        weights = [1e-3 * m * GRAVITY for m in MASSES]
        extra = [p.preload_23] if law == "nh" else []
        path = [Target(F=F, V=V) for F in [*weights, *extra] for V in (0.0, VOLTS, 0.0)]
        states = solve(Device.of(p, law=law), path)
        strokes = [states[k + 1].u - states[k].u for k in range(0, len(states), 3)]
        q |= {f"{law}_stroke_{m:g}": s for m, s in zip(MASSES, strokes, strict=False)}
        for k in range(1, len(MASSES)):
            q[f"{law}_stroke_{MASSES[k]:g}_{MASSES[k - 1]:g}"] = strokes[k] / strokes[k - 1]
        q[f"{law}_stroke_last_first"] = strokes[len(MASSES) - 1] / strokes[0]
        if law == "nh":
            q["preload23_u"] = states[-2].u
    for um in (10, 20):
        device = Device.of(p, electrode_thickness=um / 1000)
        q[f"preload36_u{um}"] = solve(device, [Target(F=p.preload_36)])[-1].u
    q["preload12_u"] = solve(Device.of(p), [Target(F=p.preload_12)])[-1].u
    return q

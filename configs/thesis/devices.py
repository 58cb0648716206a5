"""The quantities behind the thesis's windows, by the membrane or by the finite-element model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from membrane import Coupling, Layer, Membrane

from dealib.units import GRAVITY

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
            out.append(Reached(u, F, model.capacitance(), sigma, model.radial_stress()))
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
        nodes = np.unique(mesh.cells[mesh.in_region("film")])
        share = (mesh.points[nodes, 0] - d.inner) / (d.outer - d.inner)
        middle = nodes[np.abs(share - 0.5) < 0.1]
        out.append(
            Reached(
                u=-row["displacement_mm"],
                F=-row["force_N"],
                C=row["capacitance_pF"],
                charge_density=float(np.linalg.norm(found["D"][middle], axis=1).mean()),
                radial_stress=float(found["second_pk_stress"][middle, 0, 0].mean()),
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
    for law, modulus, name in (("nh", 1.0, "nh1"), ("nh", 1.5, "nh15"), ("mr", 1.25, "mr125"),
                               ("mr", 1.5, "mr15")):  # fmt: skip
        alone = Device.of(p, law=law, film_modulus=modulus, electrode_thickness=0.0)
        q[f"film_{name}_F3"] = solve(alone, push)[-1].F
    q["film_closeness"] = _difference(q["film_mr125_F3"], q["film_nh1_F3"])
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
    q["closeness"] = _difference(q["mr_F3"], q["nh_F3"])
    q["closeness_75"] = _difference(q["mr75_F3"], q["nh75_F3"])
    q["charge_spread"] = max(charges.values()) / min(charges.values()) - 1
    q["field"] = charges[100] / (8.8541878128e-6 * p.permittivity)
    q["S_100_75"], q["S_200_100"] = stresses[100] / stresses[75], stresses[200] / stresses[100]
    for law in ("nh", "mr"):
        weights = [1e-3 * m * GRAVITY for m in MASSES]
        extra = [p.preload_23] if law == "nh" else []
        path = [Target(F=F, V=V) for F in [*weights, *extra] for V in (0.0, VOLTS, 0.0)]
        states = solve(Device.of(p, law=law), path)
        strokes = [states[k + 1].u - states[k].u for k in range(0, len(states), 3)]
        q |= {f"{law}_stroke_{m:g}": s for m, s in zip(MASSES, strokes, strict=False)}
        q[f"{law}_stroke_10_5"] = strokes[1] / strokes[0]
        q[f"{law}_stroke_28_10"] = strokes[4] / strokes[1]
        if law == "nh":
            q["preload23_u"] = states[-2].u
    for um in (10, 15, 20):
        device = Device.of(p, electrode_thickness=um / 1000)
        q[f"preload36_u{um}"] = solve(device, [Target(F=p.preload_36)])[-1].u
    return q


def _difference(a: float, b: float) -> float:
    return 2 * (a - b) / (a + b)

"""The thesis's devices, by the membrane or by the finite-element model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np
from membrane import Coupling, Layer, Membrane

VOLTS = 2.5  # kV, the largest
MASSES = (5.0, 10.0, 15.0, 20.0, 25.0, 28.0)  # g, Fig. 31
MODULI = {"nh": (1.0, 3.0), "mr": (1.25, 2.0)}  # MPa, film and electrodes as the thesis chose
COUPLINGS: tuple[Coupling, ...] = get_args(Coupling)
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
Solvers = Mapping[Coupling, Solver]


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


def membranes() -> dict[Coupling, Solver]:
    """The membrane model by coupling."""
    return {coupling: by_membrane(coupling) for coupling in COUPLINGS}


def finite_elements() -> dict[Coupling, Solver]:
    """The finite-element model by coupling."""
    return {
        coupling: cached(partial(by_finite_elements, coupling=coupling)) for coupling in COUPLINGS
    }


def by_finite_elements(
    device: Device, targets: Sequence[Target], coupling: str = "energy"
) -> list[Reached]:
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
            "physics.coupling": coupling,
            "program": f"[{', '.join(program)}]",
        },
    )
    from dealib.results.fields import fields

    out = []
    for state in dealib.Simulation(case):
        if not state.end_of_stage or state.row["stage"] == "prestrain":
            continue
        row, mesh = state.row, state.engine.layout.mesh
        found = fields(case.config, mesh, state.nodal())
        share = (mesh.points[:, 0] - d.inner) / (d.outer - d.inner)
        middle = {
            region: np.intersect1d(
                mesh.cells[mesh.in_region(region)], np.flatnonzero(np.abs(share - 0.5) < 0.1)
            )
            for region in ("film", "top_electrode")[: 2 if d.electrode_thickness else 1]
        }
        stresses = [found["second_pk_stress"][nodes, 0, 0].mean() for nodes in middle.values()]
        charge = np.linalg.norm(found["D"][middle["film"]], axis=1).mean()
        out.append(
            Reached(
                -row["displacement_mm"],
                -row["force_N"],
                row["capacitance_pF"],
                float(charge),
                *map(float, stresses),
            )
        )
    return out

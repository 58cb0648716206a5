"""Maxwell branches: blocks against closed forms and ordinary differential equations.

A block between rigid walls, pressed along Z, deforms homogeneously, F = diag(1, l, 1) whatever the
branches do: the history of their strain is prescribed, and the force on its top is

    A dW/dl + A sum_k G_k/2 d/dl tr(C C_k^-1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from dealib.errors import NotConverged
from dealib.fem.layout import Layout
from dealib.fem.port_law import PortLaw
from dealib.fem.viscous import Viscosity
from dealib.program.increments import Increments
from dealib.program.predictor import Predictor
from dealib.units import EPSILON_0
from verification.bench import Bench, config
from verification.free_block import FREE
from verification.table import Row

RADII, THICKNESS = (5.0, 10.0), 0.5
AREA = float(np.pi * (RADII[1] ** 2 - RADII[0] ** 2))
CONFINED: dict[str, Any] = {
    "mounts": {"mount": {"on": "film_top", "along": "Z", "free": ["R"]}},
    "holds": [{"on": ["inner", "outer"], "fix": "R"}, {"on": "film_bottom", "fix": "Z"}],
}
LAW = {"law": "neo_hookean", "shear_modulus": 1.0, "bulk_modulus": 2.0}
BRANCHES = ((0.8, 0.5), (0.4, 5.0))  # MPa, s


class Viscous(Bench):
    """A bench with a clock.

    Args:
        law: The film's law, MPa.
        branches: Moduli (MPa), relaxation times (s) and perhaps evolutions.
        held: Sections of the config that hold the block.
        formulation: Of the config's section `physics`.
        solver: Keys of the section.
    """

    def __init__(
        self,
        law: dict[str, Any],
        branches: Any,
        held: dict[str, Any],
        formulation: str = "displacement",
        **solver: float,
    ) -> None:
        entries = [
            {"shear_modulus": f"{g!r} MPa", "relaxation_time": f"{t!r} s", "evolution": e}
            for g, t, e in ((*b, "multiplicative")[:3] for b in branches)
        ]
        given = config(
            dict(inner_radius=RADII[0], outer_radius=RADII[1], film_thickness=THICKNESS),
            law | {"branches": entries},
            mesh={"columns": 4, "film_rows": 1, "grading": "uniform"},
            physics={"formulation": formulation},
            solver={"time_tolerance": 0} | solver,
            **held,
        )
        super().__init__(given)
        layout = Layout.of(self.problem)
        self.viscosity = Viscosity(self.problem, layout)
        self.viscosity.rest()
        self.time, self._predictor = 0.0, Predictor(3, retrace=False)

    def over(self, duration: float, steps: int, **values: float) -> Iterator[float]:
        """Move ports over a time, s; yields it at each converged state."""
        begin = self.time
        start = self.system.map.port_values(self.system.q)

        def apply(at: float) -> tuple[float]:
            for port, value in values.items():
                law = PortLaw(value=start[port] + at * (value - start[port]))
                self.system.ports[port] = law
            if at * duration > self.time - begin:
                self.viscosity.begin(at * duration - (self.time - begin))
            return (at,)

        settings = self.problem.config.solver
        clocks = [self.viscosity]
        increments = Increments(self.newton, settings, self._predictor, clocks=clocks)
        targets = [k / steps for k in range(1, steps + 1)]
        for at in increments.run(targets, {1.0}, apply, lambda at: f"stopped at {at:g}"):
            self.viscosity.commit()
            self.time = begin + at * duration
            yield self.time

    def through(self, duration: float, steps: int, **values: float) -> Viscous:
        """Move ports over a time, to the end."""
        for _ in self.over(duration, steps, **values):
            pass
        return self


def metric(l: Any) -> Any:
    """Isochoric C = diag(a, b, a) of F = diag(1, l, 1): a and b."""
    return l ** (-2 / 3), l ** (4 / 3)


def slope(l: float, internal: Any) -> float:
    """tr(dC/dl C_i^-1) of C as above and C_i = diag(x, y, x)."""
    return float(-4 / 3 * l ** (-5 / 3) / internal[0] + 4 / 3 * l ** (1 / 3) / internal[1])


def exact_force(path: Callable[[float], float], times: Any) -> Any:
    """Force on the confined block at times, for a stretch l(t): scipy solves for each C_i."""
    branches = []
    for _, tau in BRANCHES:

        def rate(t: float, x: Any, tau: float = tau) -> Any:
            a, b = metric(path(t))
            trace = (2 * a / x[0] + b / x[1]) / 3
            return [(a - trace * x[0]) / tau, (b - trace * x[1]) / tau]

        found = solve_ivp(
            rate, (0, times[-1]), [1, 1], t_eval=times, rtol=1e-11, atol=1e-12, max_step=0.05
        )
        branches.append(found.y.T)
    forces = []
    for i, t in enumerate(times):
        l = path(t)
        stress = LAW["shear_modulus"] / 2 * slope(l, (1, 1)) + LAW["bulk_modulus"] * (l - 1)
        stress += sum(
            g / 2 * slope(l, internal[i])
            for (g, _), internal in zip(BRANCHES, branches, strict=True)
        )
        forces.append(AREA * stress)
    return np.array(forces)


def relaxation() -> Iterator[Row]:
    """A small strain, applied in 0.1 s and held: exponentials, exact with any increment."""
    strain, ramp = 1e-6, 0.1
    bench = Viscous(LAW, BRANCHES, CONFINED, tolerance=1e-13)
    bench.through(ramp, 1, mount=strain * THICKNESS)
    source = "sum of exponentials, small strain"
    for t, steps in ((ramp, 0), (0.6, 3), (2.0, 2), (20.0, 4)):
        if steps:
            bench.through(t - bench.time, steps, mount=strain * THICKNESS)
        modulus = LAW["bulk_modulus"] + 4 / 3 * LAW["shear_modulus"]
        for g, tau in BRANCHES:
            modulus += 4 / 3 * g * tau / ramp * -np.expm1(-ramp / tau) * np.exp((ramp - t) / tau)
        yield Row(
            "confined block with two branches, strain 1e-6", f"stress over strain at {t:g} s, MPa",
            modulus, bench.force / AREA / strain, 3e-6, source,
        )  # fmt: skip


def large_strain() -> Iterator[Row]:
    """Stretched by a half and released along a smooth path: error and order in time."""

    def path(t: float) -> float:
        return 1 + 0.5 * np.sin(t) ** 2

    times = np.linspace(0, 4, 9)
    reference = exact_force(path, times)
    errors = []
    for steps in (10, 20, 40):
        bench = Viscous(LAW, BRANCHES, CONFINED, tolerance=1e-12)
        found = [0.0]
        for t in times[1:]:
            for k in range(1, steps + 1):
                at = t - 0.5 + 0.5 * k / steps
                bench.through(0.5 / steps, 1, mount=(path(at) - 1) * THICKNESS)
            found.append(bench.force)
        errors.append(float(np.abs(found - reference).max() / np.abs(reference).max()))
    case, source = "confined block, l = 1 + 0.5 sin(t)^2", "ordinary differential equations, scipy"
    yield Row(case, "largest error of the force over it, 80 steps", 0, errors[0], 1.2e-4, source,
              "absolute")  # fmt: skip
    yield Row(case, "the same, 320 steps", 0, errors[-1], 8e-6, source, "absolute")
    order = float(np.log2(errors[-2] / errors[-1]))
    yield Row(case, "order in time", 2.0, order, 0.02, "theory", "absolute")


def loop(half_cycle: float, steps: int = 40) -> tuple[float, float]:
    """Area of the steady force-displacement loop, and what is dissipated in it, mJ.

    One branch (0.8 MPa, 0.5 s), strain 1e-3 to and fro at a constant rate.
    """
    bench = Viscous(LAW, BRANCHES[:1], CONFINED, tolerance=1e-11)
    tau, size = BRANCHES[0][1], 5e-4 * THICKNESS
    bench.through(half_cycle / 2, steps, mount=size)
    for _ in range(max(1, int(np.ceil(8 * tau / half_cycle))) // 2 * 2):
        bench.through(half_cycle, steps, mount=-bench.displacement)
    area, lost = 0.0, bench.viscosity.dissipated
    for _ in range(2):
        last = bench.force, bench.displacement
        for _ in bench.over(half_cycle, steps, mount=-bench.displacement):
            area += (last[0] + bench.force) / 2 * (bench.displacement - last[1])
            last = bench.force, bench.displacement
    return area, bench.viscosity.dissipated - lost


def loop_area(half_cycle: float, strain: float = 1e-3) -> float:
    """The same in closed form: triangular strain on a linear standard solid, mJ."""
    (g, tau), h = BRANCHES[0], half_cycle
    rate, lag = strain / h, strain / h * tau
    end = lag * np.tanh(h / (2 * tau))
    mean = lag * h - (end + lag) * tau * -np.expm1(-h / tau)
    return float(2 * 4 / 3 * g * rate * mean * AREA * THICKNESS)


def loops() -> Iterator[Row]:
    """Area of the loop against the rate, on both sides of its maximum."""
    source = "linear standard solid, triangular strain"
    for h in (0.05, 0.5, 1.0, 5.0):
        case = f"confined block, strain +-5e-4, one branch of 0.5 s, half a cycle in {h:g} s"
        area, lost = loop(h)
        yield Row(case, "area of the loop, mJ", loop_area(h), area, 2e-3, source)
        yield Row(case, "dissipated in it, mJ", loop_area(h), lost, 2e-3, source)


# --- pull-in of VHB 4910 against the rate --------------------------------------------------------

# S. Wang, M. Decker, D. L. Henann, S. A. Chester, J. Mech. Phys. Solids 95 (2016) 213
VHB_MODULUS = 15.36e-3
VHB = {
    "law": "arruda_boyce",
    "shear_modulus": VHB_MODULUS,
    "locking_stretch": 5.99,
    "bulk_modulus": 1e3 * VHB_MODULUS,
}
VHB_BRANCHES = (
    (26.06e-3, 0.6074, "network"),
    (26.53e-3, 6.56, "network"),
    (10.83e-3, 61.25, "network"),
)
PERMITTIVITY = 3 * EPSILON_0  # the bench's: only the normalised voltage matters
RAMP, STEPS = 1.6, 250  # normalised voltage at the end of the ramp, and its steps


# rates (1/s) and the last of 250 steps to 1.6 that converged in published 3-D computations
PUBLISHED = {1e-6: 0.691, 1e-3: 0.870, 1e-2: 1.101, 0.1: 1.344}


def pull_in(rate: float) -> float:
    """Last of the ramp's normalised voltages V/H sqrt(eps/G) at which a free block has a state.

    The voltage grows to 1.6 in 1/rate seconds. Near the limit point a whole step fails, so that it
    is approached in parts.
    """
    bench = Viscous(VHB, VHB_BRANCHES, FREE, max_cuts=3)
    unit = RAMP / STEPS * THICKNESS * np.sqrt(VHB_MODULUS / PERMITTIVITY)
    reached = 0
    try:
        for _ in bench.over(1 / rate, STEPS, terminal=STEPS * unit):
            reached = int(bench.voltage / unit + 1e-6)
    except NotConverged:
        return reached * RAMP / STEPS
    raise AssertionError("the ramp goes beyond pull-in")


def vhb() -> Iterator[Row]:
    """Pull-in rises with the rate."""
    for rate, published in PUBLISHED.items():
        case = f"free block of VHB 4910, V~ from 0 to {RAMP:g} in {1 / rate:g} s"
        quantity = f"last of {STEPS} values of V~ that is reached"
        yield Row(case, quantity, published, pull_in(rate), 1e-3, "Wang et al. (2016), 3-D")

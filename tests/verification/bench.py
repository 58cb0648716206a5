"""A problem on the test bench: ports set by hand, measured through the real solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from dealib.config.schema import Config
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem, build_problem
from dealib.fem.timings import Timings
from dealib.program.increments import Increments
from dealib.program.predictor import Predictor


def config(geometry: dict[str, Any], film: dict[str, Any], **sections: Any) -> Config:
    """A config of strips from plain numbers: mm and MPa."""
    return Config.model_validate(
        {
            "name": "bench",
            "geometry": {"electrode_thickness": "0 mm"} | _in(geometry, "mm"),
            "materials": {
                "film": {"relative_permittivity": 3.0} | _in(film, "MPa"),
                **{k: _in(v, "MPa") for k, v in sections.pop("materials", {}).items()},
            },
            "program": [{"stage": "rest"}],
            **sections,
        }
    )


_PLAIN = (
    "relative_permittivity",
    "prestretch",
    "law",
    "j_lim",
    "locking_stretch",
    "alpha",
    "branches",
)


def _in(section: dict[str, Any], unit: str) -> dict[str, Any]:
    def text(value: Any) -> Any:
        return [text(v) for v in value] if isinstance(value, list) else f"{value!r} {unit}"

    return {k: v if k in _PLAIN else text(v) for k, v in section.items()}


class Bench:
    """A problem at equilibrium, its ports moved by hand.

    Args:
        problem: The problem, or a config of strips.
    """

    def __init__(self, problem: Problem | Config) -> None:
        if isinstance(problem, Config):
            problem = build_problem(problem, MPI.COMM_WORLD)
        self.problem = problem
        self.newton = Newton(problem, Timings())
        self.system = self.newton.system
        problem.set_prestretch(1.0)
        self.newton.solve()

    def move(self, *, steps: int = 1, **values: float) -> Bench:
        """Prescribe ports (`mount` in mm, `terminal` in kV), in equal steps from where they are."""
        start = self.system.map.port_values(self.system.q)

        def law(port: str, at: float) -> PortLaw:
            return PortLaw(value=start[port] + at * (values[port] - start[port]))

        return self._ramp(steps, lambda at: {port: law(port, at) for port in values})

    def load(self, *, steps: int = 1, **duals: float) -> Bench:
        """Prescribe duals of ports (`mount`: force in N, `terminal`: charge in uC) likewise."""
        start = {port: self.dual(port) for port in duals}

        def law(port: str, at: float) -> PortLaw:
            now = start[port] + at * (duals[port] - start[port])
            return PortLaw(load=self.problem.device.by_name[port].kind.sign * now)

        return self._ramp(steps, lambda at: {port: law(port, at) for port in duals})

    def _ramp(self, steps: int, laws: Callable[[float], dict[str, PortLaw]]) -> Bench:
        """Follow the ports' equations from 0 to 1, in smaller steps where Newton fails."""

        def apply(at: float) -> tuple[float]:
            self.system.ports.update(laws(at))
            return (at,)

        increments = Increments(self.newton, self.problem.config.solver, Predictor())
        targets = [k / steps for k in range(1, steps + 1)]
        for _ in increments.run(
            targets,
            {1.0},
            apply,
            lambda at: f"stopped at {at:g} of the ramp",
        ):
            pass
        return self

    def value(self, port: str) -> float:
        """Of a port: displacement (mm), voltage (kV), pressure (MPa)."""
        return self.system.map.port_values(self.system.q)[port]

    def dual(self, port: str) -> float:
        """Of a port: force (N), charge (uC), displaced volume (mm^3)."""
        return self.problem.device.by_name[port].kind.sign * self.system.internal[port]

    @property
    def displacement(self) -> float:
        """Of the mount, mm."""
        return self.value("mount")

    @property
    def voltage(self) -> float:
        """Of the terminal, kV."""
        return self.value("terminal")

    @property
    def force(self) -> float:
        """On the mount, N."""
        return self.dual("mount")

    @property
    def charge(self) -> float:
        """On the terminal, uC."""
        return self.dual("terminal")

    @property
    def elastic(self) -> float:
        """Elastic energy, mJ."""
        return self.problem.integrate("elastic")

    @property
    def potential(self) -> float:
        """Total potential without the ports' work, elastic minus electric energy, mJ."""
        return self.problem.integrate("elastic") + self.problem.integrate("electric")

    def values(self, quantity: str, where: str) -> Any:
        """Nodal values of u_R, u_Z, ... or phi on a named region or boundary (serial)."""
        from dolfinx import fem

        W, domain = self.problem.spaces.W, self.problem.domain
        space = W.sub(1)
        if quantity != "phi":
            axis = self.problem.kinematics.axes.index(quantity.removeprefix("u_"))
            space = W.sub(0).sub(axis)
        dofs = fem.locate_dofs_topological(space, *domain.entities(where))
        return self.problem.spaces.w.x.array[dofs]

    def largest(self, quantity: str, where: str) -> float:
        """Largest of `values`."""
        return float(self.values(quantity, where).max())

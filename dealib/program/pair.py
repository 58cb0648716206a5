"""Two port variables in which a branch is followed: the equation of an arc, and its direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dealib.config.follow import PORT_OF, Variable
from dealib.fem.newton import Newton
from dealib.fem.problem import Problem
from dealib.fem.system import PortLaw, System

_DUALS = {"force": 1.0, "charge": -1.0}  # sign from dPi/dq to the user's dual
COLUMN: dict[str, str] = {
    "displacement": "displacement_mm",
    "force": "force_N",
    "voltage": "voltage_kV",
    "charge": "charge_uC",
}
_TILT = 0.05  # least share of a dual in an arc's equation, which keeps it regular

Two = tuple[float, float]


@dataclass(frozen=True)
class Pair:
    """The variable that is set free and the one beside it, each with a size.

    Attributes:
        vary: What is set free.
        along: What else measures the path.
        sizes: Of both, in their units.
    """

    vary: Variable
    along: Variable
    sizes: Two

    @property
    def port(self) -> str:
        """Whose equation becomes that of the arc."""
        return PORT_OF[self.vary]

    @property
    def crossed(self) -> bool:
        """Whether the variables are of two ports."""
        return PORT_OF[self.along] != self.port

    def point(self, system: System) -> Two:
        """Both variables at the last residual."""
        return value(system, self.vary), value(system, self.along)

    def control(self, x: float) -> PortLaw:
        """The equation of the port under control of the varied variable."""
        return _given(self.vary, x)

    def end(self, y: float) -> PortLaw:
        """The equation of the port that puts the other variable at its end."""
        if self.crossed:
            return PortLaw(value=y, weights=((PORT_OF[self.along], 1.0),))
        return _given(self.along, y)

    def arc(self, point: Two, direction: Two, step: float) -> PortLaw:
        """The equation direction . (variables - point) / sizes = step.

        Where a dual enters, it is divided by that dual's factor: the tangent then differs from that
        of the loaded port on its diagonal only, and stays symmetric for the two variables of one
        port. The factor is kept from zero, which turns the plane of the arc a little.
        """
        factors, right = {}, step
        for name, at, share, size in self._each(point, direction):
            if name in _DUALS:
                share = math.copysign(max(abs(share), _TILT), share)
            factors[name] = share / size
            right += share * at / size
        weights = {PORT_OF[n]: f for n, f in factors.items() if n not in _DUALS}
        dual = next((n for n in factors if n in _DUALS), None)
        if dual is None:
            return PortLaw(value=right, weights=tuple(weights.items()))
        scale = _DUALS[dual] * factors[dual]
        return PortLaw(
            load=right / scale, weights=tuple((n, f / scale) for n, f in weights.items())
        )

    def direction(self, newton: Newton, arc: PortLaw) -> tuple[Two, Any]:
        """Unit direction of the branch in both variables over their sizes, and in all unknowns.

        Args:
            newton: At a state; its ports are left with the equation of the arc.
            arc: An arc through the state that crosses the branch.
        """
        system = newton.system
        system.ports[self.port] = arc
        rate = newton.response(self.port)
        ports = system.map.port_values(rate)
        internal = 1 - sum(weight * ports[name] for name, weight in arc.weights)

        def of(name: str) -> float:
            return _DUALS[name] * internal if name in _DUALS else ports[PORT_OF[name]]

        x, y = of(self.vary) / self.sizes[0], of(self.along) / self.sizes[1]
        length = math.hypot(x, y)
        rate.scale(1 / length)
        return (x / length, y / length), rate

    def _each(self, point: Two, direction: Two) -> Any:
        return zip((self.vary, self.along), point, direction, self.sizes, strict=True)


def value(system: System, name: str) -> float:
    """A port variable at the last residual."""
    if name in _DUALS:
        return _DUALS[name] * system.internal[PORT_OF[name]]
    return system.values[PORT_OF[name]]


def _given(name: str, at: float) -> PortLaw:
    return PortLaw(load=_DUALS[name] * at) if name in _DUALS else PortLaw(value=at)


def size(problem: Problem, name: str) -> float:
    """Size of a port variable for a film: of its span, its strength, its electric strength."""
    g, film = problem.config.geometry, problem.config.materials.film
    area = math.pi * (g.outer_radius**2 - g.inner_radius**2)
    permittivity = problem.charge_scale * g.film_thickness / area
    volts = g.film_thickness * math.sqrt(film.shear_modulus_at_rest / permittivity)
    return {
        "displacement": g.outer_radius - g.inner_radius,
        "force": problem.force_scale,
        "voltage": volts,
        "charge": problem.charge_scale * volts,
    }[name]

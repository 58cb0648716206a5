"""The two port variables of a followed branch: the equation of the arc, and its direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dealib.device.device import Device
from dealib.device.records import Port, PortQuantity
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem
from dealib.fem.system import System

_TILT = 0.05  # least share of a dual in an arc's equation, which keeps it regular

Two = tuple[float, float]


@dataclass(frozen=True)
class PortVariable:
    """A variable of one of the device's ports.

    Attributes:
        name: Such as 'voltage', or 'voltage.NAME' where there are several terminals.
        port: Its port.
    """

    name: str
    port: Port

    @classmethod
    def of(cls, device: Device, name: str) -> PortVariable:
        """By its name."""
        return cls(name, device.variables[name])

    @property
    def variable(self) -> PortQuantity:
        """What it is."""
        stem = self.name.partition(".")[0]
        return next(v for v in self.port.kind.variables if v.name == stem)

    @property
    def column(self) -> str:
        """Its column of the history."""
        return self.port.column(self.variable)

    @property
    def dual(self) -> bool:
        """Whether it is the dual of its port's value."""
        return self.variable == self.port.kind.dual

    @property
    def sign(self) -> float:
        """From dPi/dq to a dual."""
        return self.port.kind.sign

    def value(self, system: System) -> float:
        """Its value at the last residual."""
        if self.dual:
            return self.sign * system.internal[self.port.name]
        return system.values[self.port.name]

    def given(self, at: float) -> PortLaw:
        """The equation of its port if it is prescribed."""
        return PortLaw(load=self.sign * at) if self.dual else PortLaw(value=at)

    def size(self, problem: Problem) -> float:
        """Its characteristic size, from the film's dimensions, modulus and permittivity."""
        sizes, modulus = problem.domain.sizes, problem.config.film.shear_modulus_at_rest
        permittivity = problem.charge_scale * sizes.thickness / sizes.area
        volts = sizes.thickness * math.sqrt(modulus / permittivity)
        return {
            "displacement": sizes.span,
            "force": problem.force_scale,
            "rotation": 1.0,
            "moment": problem.force_scale * sizes.span,
            "voltage": volts,
            "charge": problem.charge_scale * volts,
            "pressure": modulus * sizes.thickness / sizes.span,
            "volume": sizes.area * sizes.span,
        }[self.variable.name]


@dataclass(frozen=True)
class Pair:
    """The varied variable and a second one, which together measure the arc length.

    Attributes:
        vary: The variable whose port gets the equation of the arc.
        along: The second variable.
        sizes: Characteristic sizes of both, in their units.
    """

    vary: PortVariable
    along: PortVariable
    sizes: Two

    @property
    def port(self) -> str:
        """Name of the port that gets the equation of the arc."""
        return self.vary.port.name

    @property
    def crossed(self) -> bool:
        """Whether the variables are of two ports."""
        return self.along.port != self.vary.port

    def point(self, system: System) -> Two:
        """Both variables at the last residual."""
        return self.vary.value(system), self.along.value(system)

    def control(self, x: float) -> PortLaw:
        """The equation of the port under control of the varied variable."""
        return self.vary.given(x)

    def end(self, y: float) -> PortLaw:
        """The equation of the port that puts the second variable at its end."""
        if self.crossed:
            return PortLaw(value=y, weights=((self.along.port.name, 1.0),))
        return self.along.given(y)

    def arc(self, point: Two, direction: Two, step: float) -> PortLaw:
        """The equation direction . (variables - point) / sizes = step.

        If a dual enters, the equation is divided by the dual's factor. The tangent then differs
        from that of the loaded port on its diagonal only, and stays symmetric for two variables of
        one port. The factor is kept away from zero, which turns the plane of the arc slightly.
        """
        weights, dual, right = [], None, step
        parts = zip((self.vary, self.along), point, direction, self.sizes, strict=True)
        for variable, at, share, size in parts:
            if variable.dual:
                share = math.copysign(max(abs(share), _TILT), share)
                dual = variable.sign * share / size
            else:
                weights.append((variable.port.name, share / size))
            right += share * at / size
        if dual is None:
            return PortLaw(value=right, weights=tuple(weights))
        return PortLaw(load=right / dual, weights=tuple((n, f / dual) for n, f in weights))

    def direction(self, newton: Newton, arc: PortLaw) -> tuple[Two, Any]:
        """Unit direction of the branch in both variables over their sizes, and in all unknowns.

        Args:
            newton: At a state; its ports are left with the equation of the arc.
            arc: An arc through the state that crosses the branch.
        """
        system = newton.system
        system.ports[self.port] = arc
        (rate,) = newton.responses(self.port)
        ports = system.map.port_values(rate)
        internal = 1 - sum(weight * ports[name] for name, weight in arc.weights)

        def of(variable: PortVariable) -> float:
            return variable.sign * internal if variable.dual else ports[variable.port.name]

        x, y = of(self.vary) / self.sizes[0], of(self.along) / self.sizes[1]
        length = math.hypot(x, y)
        rate.scale(1 / length)
        return (x / length, y / length), rate

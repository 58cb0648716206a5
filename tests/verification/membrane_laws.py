"""Other laws and a permittivity that depends on stretch, against the incompressible membrane ODE.

A layer is given by its principal stress difference s1 - s3 at (l1, l2, l3 = 1/(l1 l2)), written out
here. With eps = a + b sqrt(l1 l2) the energy -(eps/2) (V/H)^2 (l1 l2)^2 adds the nominal stress
-(V/H)^2 l1 l2^2 (eps + b sqrt(l1 l2)/4).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from dealib.units import EPSILON_0
from verification.bench import Bench, config
from verification.membrane_ode import Layer, Membrane
from verification.table import Row

RADIUS = 10.0


@dataclass(frozen=True)
class LawLayer(Layer):
    """An incompressible layer of any law.

    Attributes:
        difference: s1 - s3 by (l1, l2, l3), MPa.
        slope: Change of the permittivity a unit of sqrt(l1 l2), N/kV^2.
    """

    difference: Callable[[Any, Any, Any], Any] = lambda l1, l2, l3: 0.0
    slope: float = 0.0

    def tension(self, g: Any, other: Any, voltage: float) -> Any:
        """See `Layer`."""
        l, m = self.mounted * g, self.mounted * other
        field, area = voltage / self.thickness, (l * m) ** 0.5
        eps = self.permittivity + self.slope * area
        stress = self.difference(l, m, 1 / (l * m)) / l
        stress = stress - field**2 * l * m**2 * (eps + self.slope * area / 4)
        return self.thickness / self.mounted * stress

    def capacitance(self, g: Any, other: Any, voltage: float) -> Any:
        """See `Layer`."""
        l, m = self.mounted * g, self.mounted * other
        eps = self.permittivity + self.slope * (l * m) ** 0.5
        return eps * g * other * l * m / self.thickness


@dataclass(frozen=True)
class Sheet:
    """A membrane of one film, b/a = 2, pushed by its radius at V/H.

    Attributes:
        name: As the table shows it.
        given: Law and permittivity as in a config, MPa.
        difference: See `LawLayer`.
        permittivity: Relative, at no stretch, and its slope.
        prestretch: Equal-biaxial.
        field: V/H, kV/mm.
    """

    name: str
    given: dict[str, Any]
    difference: Callable[[Any, Any, Any], Any]
    permittivity: tuple[float, float]
    prestretch: float
    field: float

    def rows(self) -> Iterator[Row]:
        """Force and capacitance in the mixed form, extrapolated to H/a = 0."""
        a, b = (EPSILON_0 * p for p in self.permittivity)
        H = 0.01 * RADIUS
        layer = LawLayer(
            H, 0.0, mounted=self.prestretch, permittivity=a, slope=b, difference=self.difference
        )
        force, capacitance = Membrane(RADIUS, 2 * RADIUS, (layer,)).push(RADIUS, self.field * H)
        thick, thin = self.bench(2 * H), self.bench(H)
        case = f"membrane, mixed form, {self.name}, lp = {self.prestretch:g}, u/a = 1"
        source = "membrane ODE, scipy, incompressible"
        found = 2 * -thin.force - (-thick.force / 2)
        yield Row(case, f"F, N, at {self.field:g} MV/m", force, found, 1e-3, source)
        found = 2 * thin.charge / thin.voltage - 2 * thick.charge / thick.voltage
        yield Row(case, "C, nF", capacitance, found, 1e-3, source)

    def bench(self, thickness: float) -> Bench:
        """The device in finite elements at an unstretched thickness, mm."""
        a, b = self.permittivity
        film = self.given | {
            "bulk_modulus": 3e4,
            "prestretch": self.prestretch,
            "relative_permittivity": {"intercept": a, "slope": b},
        }
        geometry = {
            "inner_radius": RADIUS,
            "outer_radius": 2 * RADIUS,
            "film_thickness": thickness / self.prestretch**2,
        }
        mesh = {"columns": 40, "film_rows": 2, "grading": "ends"}
        bench = Bench(config(geometry, film, mesh=mesh, physics={"formulation": "mixed"}))
        bench.move(steps=15, mount=-RADIUS)
        return bench.move(steps=3, terminal=self.field * thickness)


def _by_I1(slope: Callable[[Any], Any]) -> Callable[[Any, Any, Any], Any]:
    """s1 - s3 = 2 dW/dI1 (l1^2 - l3^2)."""
    return lambda l, m, t: 2 * slope(l * l + m * m + t * t) * (l * l - t * t)


def _ogden(l: Any, m: Any, t: Any) -> Any:
    return sum(u * (l**a - t**a) for u, a in ((0.63, 1.3), (0.0012, 5.0), (-0.01, -2.0)))


elastosil = Sheet(
    "Yeoh (Elastosil 2030), eps_r = 2.76 - 0.28 l",
    {"law": "yeoh", "c10": 0.1807, "c20": -0.0167, "c30": 0.0066},
    _by_I1(lambda I1: 0.1807 - 0.0334 * (I1 - 3) + 0.0198 * (I1 - 3) ** 2),
    (2.76, -0.28), 1.2, 40.0,
).rows  # fmt: skip
gent = Sheet(
    "Gent J_lim = 6",
    {"law": "gent", "shear_modulus": 0.4, "j_lim": 6.0},
    _by_I1(lambda I1: 0.2 * 6 / (9 - I1)), (3.0, 0.0), 1.3, 40.0,
).rows  # fmt: skip
ogden = Sheet(
    "Ogden, three terms",
    {"law": "ogden", "mu": [0.63, 0.0012, -0.01], "alpha": [1.3, 5.0, -2.0]},
    _ogden, (3.0, 0.0), 1.2, 40.0,
).rows  # fmt: skip

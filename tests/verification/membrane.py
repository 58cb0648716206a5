"""The device tends to its thin limit, an annular membrane, as its thickness goes to zero.

The limit comes from `membrane_ode`, for the same bulk modulus. The ends of a body of finite
thickness are clamped over their height: what differs is of first order in H/a.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from dealib.units import EPSILON_0
from verification.bench import Bench, config
from verification.membrane_ode import Layer, Membrane
from verification.table import Row

EPSILON, MU, RADIUS = 3 * EPSILON_0, 1.0, 10.0
ODE = "membrane ODE, scipy, same kappa"


@dataclass(frozen=True)
class Sheet:
    """A membrane device: lengths relative to the disc's radius a, moduli to the film's mu.

    Attributes:
        frame: b/a.
        prestretch: lp.
        push: u/a.
        phi: (V/H) sqrt(eps/mu).
        second: C01/(C10 + C01).
        electrodes: Thickness of both electrodes together over the film's, both mounted.
        kappa: kappa/mu, of the electrodes as well.
        formulation: displacement or mixed.
    """

    frame: float
    prestretch: float
    push: float
    phi: float
    second: float = 0.0
    electrodes: float = 0.0
    kappa: float = 50.0
    formulation: str = "displacement"

    def __str__(self) -> str:
        text = f"b/a = {self.frame:g}, lp = {self.prestretch:g}, u/a = {self.push:g}"
        text += f", phi~ = {self.phi:g}, kappa/mu = {self.kappa:g}"
        if self.second:
            text += f", Mooney-Rivlin C01/mu = {self.second / 2:g}"
        return text + (f", electrodes {self.electrodes:g} h" if self.electrodes else "")

    def layers(self, thinness: float) -> tuple[Layer, ...]:
        """Film and electrodes (three times as stiff) at H/a, H of all layers together."""
        c10, c01 = MU / 2 * (1 - self.second), MU / 2 * self.second
        thickness = thinness * RADIUS / (1 + self.electrodes)
        film = Layer(thickness, c10, c01, self.kappa * MU, self.prestretch, permittivity=EPSILON)
        if not self.electrodes:
            return (film,)
        thickness = self.electrodes * film.mounted_thickness
        return film, Layer(thickness, 1.5 * MU, kappa=3 * MU * self.kappa)

    def voltage(self, thinness: float) -> float:
        """In kV."""
        return float(self.phi * self.layers(thinness)[0].thickness * np.sqrt(MU / EPSILON))

    def limit(self, thinness: float) -> tuple[float, float]:
        """Force (N) and capacitance (nF) of the membrane."""
        membrane = Membrane(RADIUS, self.frame * RADIUS, self.layers(thinness))
        return membrane.push(self.push * RADIUS, self.voltage(thinness))

    def bench(self, thinness: float, columns: int = 60, rows: int = 2) -> Bench:
        """The device in finite elements, pushed and under voltage."""
        film, *electrodes = self.layers(thinness)
        law = {"law": "mooney_rivlin", "c10": film.c10, "c01": film.c01}
        if not self.second:
            law = {"law": "neo_hookean", "shear_modulus": MU}
        law |= {"bulk_modulus": film.kappa, "prestretch": film.mounted}
        geometry = {
            "inner_radius": RADIUS,
            "outer_radius": RADIUS * self.frame,
            "film_thickness": film.mounted_thickness,
        }
        materials = {}
        for layer in electrodes:
            geometry["electrode_thickness"] = layer.thickness / 2
            stiff = {"shear_modulus": 2 * layer.c10, "bulk_modulus": layer.kappa}
            materials["electrode"] = {"law": "neo_hookean"} | stiff
        mesh = {"columns": columns, "film_rows": rows, "grading": "ends"}
        physics = {"formulation": self.formulation}
        bench = Bench(config(geometry, law, mesh=mesh, materials=materials, physics=physics))
        bench.move(steps=15, mount=-self.push * RADIUS)
        return bench.move(steps=3, terminal=self.voltage(thinness) or 1e-6)

    def errors(self, thinness: float, **mesh: int) -> tuple[float, float]:
        """Relative difference of force and capacitance from the limit."""
        force, capacitance = self.limit(thinness)
        bench = self.bench(thinness, **mesh)
        return -bench.force / force - 1, bench.charge / bench.voltage / capacitance - 1


def against_ode(sheet: Sheet) -> Iterator[Row]:
    """Within 0.7 % at H/a = 0.01, and first order in H/a: the force from above, C from below."""
    thick, thin = sheet.errors(0.02), sheet.errors(0.01)
    case = f"membrane, {sheet}"
    for k, quantity in enumerate(("force", "capacitance")):
        sign = "above" if thin[k] > 0 else "below"
        name = f"{quantity} over the limit's, H/a = 0.01, from {sign}"
        yield Row(case, name, 1.0, 1 + thin[k], 7e-3, ODE)
        order = float(np.log2(thick[k] / thin[k]))
        yield Row(case, f"order of the {quantity} in H/a", 1.0, order, 0.15, "theory", "absolute")


def tabulated() -> Iterator[Row]:
    """The ODE gives the known numbers, and dealib nearly incompressible at H/a = 0.01 as well."""
    known = ((0.0, 8.307286), (0.1, 8.176674), (0.2, 7.782929), (0.3, 7.119352))
    for phi, force in known:
        sheet = Sheet(2, 1.2, 1, phi, kappa=np.inf)
        case = "membrane ODE itself, b/a = 2, lp = 1.2, u/a = 1"
        computed = sheet.limit(0.01)[0] / (MU * 0.01 * RADIUS**2)
        yield Row(case, f"F/(mu H a) at phi~ = {phi:g}", force, computed, 2e-7, "tabulated")
    for phi, capacitance in ((0.0, 26.584370), (0.3, 26.734910)):
        computed = Sheet(2, 1.2, 1, phi, kappa=np.inf).limit(0.01)[1] * 0.01 / (EPSILON * RADIUS)
        yield Row(
            case, f"C H/(eps a^2) at phi~ = {phi:g}", capacitance, computed, 2e-7, "tabulated"
        )
    lp, phi = 1.2, 0.2
    small = Sheet(2, lp, 1e-3, phi, kappa=np.inf)
    slope = 2 * np.pi * (lp**2 - lp**-4 - (phi * lp**2) ** 2) / (lp**2 * np.log(2))
    computed = small.limit(0.01)[0] / (MU * 0.01 * RADIUS**2 * 1e-3)
    yield Row(case, "F/(mu H u) at small u, phi~ = 0.2", slope, computed, 1e-5, "closed form")
    for phi, force in known[::3]:
        sheet = Sheet(2, 1.2, 1, phi, kappa=1000)
        computed = -sheet.bench(0.01).force / (MU * 0.01 * RADIUS**2)
        case = f"membrane, {sheet}"
        yield Row(
            case, "F/(mu H a), H/a = 0.01", force, computed, 7e-3, "tabulated, incompressible"
        )


def incompressible() -> Iterator[Row]:
    """The mixed form at kappa/G = 1e5, extrapolated to H/a = 0, is the incompressible membrane."""
    for phi, known in ((0.0, 8.307286), (0.3, 7.119352)):
        sheet = Sheet(2, 1.2, 1, phi, kappa=1e5, formulation="mixed")
        thick, thin = (
            -sheet.bench(h, columns=40).force / (MU * h * RADIUS**2) for h in (0.02, 0.01)
        )
        case, quantity = f"membrane, mixed form, {sheet}", "F/(mu H a), extrapolated in H/a"
        yield Row(case, quantity, known, 2 * thin - thick, 1e-3, "tabulated, incompressible")


voltage = partial(against_ode, Sheet(2, 1.2, 1, 0.3))
no_voltage = partial(against_ode, Sheet(2, 1.2, 1, 0.0))
narrow = partial(against_ode, Sheet(1.5, 1.1, 0.4, 0.2))
mooney_rivlin = partial(against_ode, Sheet(3, 1.4, 1.5, 0.2, second=0.2))
electrodes = partial(against_ode, Sheet(2, 1.2, 1, 0.3, electrodes=0.6))
thick_electrodes = partial(against_ode, Sheet(1.48, 1.15, 0.36, 0.15, electrodes=0.667))

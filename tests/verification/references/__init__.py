"""Reference solutions of dielectric elastomer devices without finite elements.

They use numpy and scipy alone and share no code with dealib: equilibrium is written down for each
device and solved as a closed form, a root, an integral or an ordinary differential equation.

Units are mm, N, MPa, kV, s and t: permittivity N/kV^2 (vacuum: `EPS0`), charge uC, capacitance nF,
resistance Gohm, density t/mm^3. All formulas are consistent, so any other consistent set works too;
with a shear modulus and a permittivity of 1 the numbers are dimensionless.

Films are incompressible, the electrodes have no stiffness and no mass, and there is no field
outside the film. A law is its energy W(l1, l2) by two principal stretches, l3 = 1/(l1 l2) (`laws`).
With e the true field, the total (elastic and Maxwell) true stress of a film without traction on its
faces is l1 dW/dl1 - eps e^2 in its plane.

| module | what |
|---|---|
| `laws` | energies, their derivatives, a film as it is mounted |
| `continuation` | roots along a line, paths, limit points (pull-in) |
| `block` | free block: equal-biaxial, uniaxial, plane strain; voltage and dead load |
| `strip` | pure-shear strip |
| `circle` | expanding circle |
| `annulus` | annular membrane with a rigid disc, and its linear limit |
| `diaphragm` | circular diaphragm under pressure and voltage |
| `cone` | preformed cone pulled by its plate |
| `meridian` | the equations of those three |
| `tube`, `balloon` | thick tube; spherical balloon, thick and thin, with its motion |
| `unimorph` | bending of two layers |
| `wrinkling` | loss of tension, natural width, sheared strip in tension-field theory |
| `frequencies` | membranes, rigid plates in them, a cantilever |
| `oscillator` | one degree of freedom, generalised-alpha method |
| `capacitor` | two strips in the plane: homogeneous, infinite sheet, finite slab |
| `line` | resistive electrodes, with the driver's resistance |
| `sound` | baffled piston of any profile |
| `chamber` | gas in a chamber with an orifice |
"""

EPS0 = 8.8541878128e-6  # N/kV^2

"""What must hold for every deformation, law and quantity: properties, with hypothesis."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from dealib.config.materials import Material
from dealib.config.schema import Config
from dealib.fem import energies
from dealib.fem.energies import Hyperelastic, IdealDielectric, MeshElasticity, Point
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import build_problem
from dealib.fem.timings import Timings
from dealib.materials import LAWS, thickness_stretch
from dealib.results import stress
from dealib.units import DIMENSIONS, parse, write

settings.register_profile("dealib", max_examples=50, deadline=None, derandomize=True)
settings.load_profile("dealib")


def film(law, **parameters):
    return TypeAdapter(Material).validate_python(
        {"law": law, "relative_permittivity": 3.0} | parameters
    )


def of_modulus(law, modulus):
    return film(law, **LAWS[law].example() | {"youngs_modulus": f"{modulus!r} MPa"})


laws = st.builds(of_modulus, st.sampled_from(sorted(LAWS)), st.floats(0.1, 10))
strains = st.floats(-0.3, 0.3)
angles = st.floats(-np.pi, np.pi)
stretches = st.floats(0.8, 1.3)


@st.composite
def deformations(draw):
    """Axisymmetric F: rotated stretches in the meridian plane, and a hoop stretch."""
    F = np.eye(3)
    F[:2, :2] += np.array([[draw(strains), draw(strains)], [draw(strains), draw(strains)]])
    F[2, 2] += draw(strains)
    assume(np.linalg.det(F) > 0.3)
    return F


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def number(expression):
    """Value of a UFL expression of numbers alone."""
    return float(apply_derivatives(apply_algebra_lowering(expression))(()))


def numbers(tensor):
    """Values of a UFL expression of shape (3, 3), derived once for all its components."""
    known = apply_derivatives(apply_algebra_lowering(tensor))
    return np.array([[float(known[i, j](())) for j in range(3)] for i in range(3)])


def hyperelastic(law, prestretch=None):
    return Hyperelastic("film", law, SimpleNamespace(**law.parameters), prestretch)


def point(F, E=(0.0, 0.0, 0.0)):
    """A point of a deformation and a field: their position and displacement do not matter."""
    return Point(None, None, F, ufl.as_vector(list(map(float, E))))


def density(energy, F, E=(0.0, 0.0, 0.0)):
    return number(energies.density(energy, point(ufl.as_matrix(F.tolist()), E)))


# --- energies ------------------------------------------------------------------------------------


@pytest.mark.once
@given(laws, deformations(), angles, strains, strains)
def test_frame_indifference(law, F, angle, E_R, E_Z):
    """A rotation after the deformation changes no energy."""
    turned = rotation(angle) @ F
    for energy in (
        hyperelastic(law),
        hyperelastic(law, [1.2, 0.7, 1.15]),
        IdealDielectric("film", 3e-5),
        MeshElasticity("air", 1e-6),
    ):
        field = 100 * np.array([E_R, E_Z, 0])
        before, after = density(energy, F, field), density(energy, turned, field)
        assert after == pytest.approx(before, rel=1e-11, abs=1e-13 * law.shear_modulus_at_rest)


@pytest.mark.once
@given(laws, deformations(), angles)
def test_isotropy(law, F, angle):
    """A rotation before the deformation changes no elastic energy."""
    before, after = (density(hyperelastic(law), G) for G in (F, F @ rotation(angle)))
    assert after == pytest.approx(before, rel=1e-11, abs=1e-13 * law.shear_modulus_at_rest)


@pytest.mark.once
@given(laws)
def test_rest_is_free_of_energy_and_stress(law):
    assert density(hyperelastic(law), np.eye(3)) == 0
    assert np.abs(stress.second_pk(law, np.eye(3))).max() < 1e-13 * law.shear_modulus_at_rest
    F = ufl.variable(ufl.as_matrix(np.eye(3).tolist()))
    P = ufl.diff(energies.density(hyperelastic(law), point(F)), F)
    assert np.abs(numbers(P)).max() < 1e-13 * law.shear_modulus_at_rest


@pytest.mark.once
@given(laws, st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_energy_grows_from_rest(law, direction):
    """Positive definite at rest: any small strain costs at least that of shear."""
    a, b, c, d = direction
    strain = np.array([[a, b, 0], [b, c, 0], [0, 0, d]])
    size = np.linalg.norm(strain)
    assume(size > 0.1)
    h = 1e-3 / size
    up, down = (density(hyperelastic(law), np.eye(3) + s * h * strain) for s in (1, -1))
    curvature = (up + down) / (h * size) ** 2  # at rest the energy itself is zero
    assert curvature > 1.9 * law.shear_modulus_at_rest


@pytest.mark.once
@given(laws, deformations(), st.sampled_from([None, (1.2, 0.7, 1.15)]))
def test_numpy_stress_is_the_derivative_of_the_energy_of_the_forms(law, F, prestretch):
    """P = F S, S from numpy, P from UFL: the results show what the solver solved."""
    variable = ufl.variable(ufl.as_matrix(F.tolist()))
    P = ufl.diff(energies.density(hyperelastic(law, prestretch), point(variable)), variable)
    derived = numbers(P)
    S = stress.second_pk(law, F, None if prestretch is None else np.array(prestretch))
    assert np.allclose(S, S.T, rtol=0, atol=1e-12 * np.abs(S).max())
    assert np.allclose(derived, F @ S, rtol=0, atol=1e-11 * law.bulk_modulus)


@pytest.mark.once
@given(deformations(), strains, strains)
def test_maxwell_stress_is_the_derivative_of_the_electric_energy(F, E_R, E_Z):
    """J sigma = dW_e/dF F^T at a given nominal field."""
    permittivity, E = 3e-5, 100 * np.array([E_R, E_Z, 0])
    variable = ufl.variable(ufl.as_matrix(F.tolist()))
    energy = IdealDielectric("film", permittivity)
    P = ufl.diff(energies.density(energy, point(variable, E)), variable)
    derived = numbers(P)
    e = np.linalg.solve(F.T, E)
    wanted = np.linalg.det(F) * stress.maxwell(permittivity, e) @ np.linalg.inv(F).T
    assert np.allclose(derived, wanted, rtol=0, atol=1e-12)


@given(laws, stretches, stretches)
def test_thickness_stretch_leaves_no_thickness_stress(law, radial, hoop):
    F = np.diag([radial, thickness_stretch(law, radial, hoop), hoop])
    S = stress.second_pk(law, F)
    assert abs(S[1, 1]) < 1e-11 * law.bulk_modulus
    assert F[1, 1] == pytest.approx(1 / (radial * hoop), rel=0.05)  # nearly isochoric


# --- assembled system ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def newton():
    """A coarse device with electrodes, without air, its ports loaded rather than prescribed."""
    config = Config.model_validate(
        {
            "name": "coarse",
            "geometry": {
                "inner_radius": "5 mm",
                "outer_radius": "8 mm",
                "film_thickness": "100 um",
                "electrode_thickness": "20 um",
            },
            "mesh": {"columns": 4, "film_rows": 1},
            "materials": {
                "film": {
                    "law": "neo_hookean",
                    "youngs_modulus": "1 MPa",
                    "relative_permittivity": 3.0,
                },
                "electrode": {"law": "mooney_rivlin", "youngs_modulus": "2 MPa"},
            },
            "program": [{"stage": "rest"}],
        }
    )
    solver = Newton(build_problem(config, MPI.COMM_SELF), Timings())
    solver.system.ports.update(mount=PortLaw(load=0.0), terminal=PortLaw(load=0.0))
    return solver


def tangent(newton, prestretch, q):
    """Dense tangent at reduced unknowns."""
    system = newton.system
    system.problem.set_prestretch(0.0)
    (film,) = (group for group in system.problem.groups if group.name == "film")
    film.prestretch.value[:] = prestretch
    vector = system.q.copy()
    vector.array[:] = q
    system.residual(vector, system.residual_vector)
    system.tangent(system.matrix)
    return system.matrix.convert("dense").getDenseArray().copy()


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), stretches, stretches)
def test_tangent_is_symmetric(newton, seed, radial, hoop):
    """Without air, at any state: it is the second derivative of one potential."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1, 1, newton.system.q.size)
    q[: len(newton.system.map.field)] *= np.where(newton.system.map.field == 1, 1.0, 2e-3)
    q[-2:] *= 1e-3, 1.0
    A = tangent(newton, (radial, 1 / (radial * hoop), hoop), q)
    assert np.abs(A - A.T).max() < 1e-12 * np.abs(A).max()


def test_tangent_at_rest_is_definite_by_blocks(newton):
    """Positive in the displacements (stable), negative in the potentials (a saddle)."""
    A = tangent(newton, (1, 1, 1), 0.0)
    field = newton.system.map.field
    u, phi = np.flatnonzero(field == 0), np.flatnonzero(field == 1)
    mount, terminal = len(field), len(field) + 1
    assert len(u) > 0 < len(phi)
    u, phi = np.append(u, mount), np.append(phi, terminal)
    assert np.abs(A[np.ix_(u, phi)]).max() == 0  # no field, no coupling
    for block, sign in ((u, 1), (phi, -1)):
        eigenvalues = sign * np.linalg.eigvalsh(A[np.ix_(block, block)])
        assert eigenvalues.min() > 1e-9 * eigenvalues.max()


# --- units ---------------------------------------------------------------------------------------


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(DIMENSIONS)))
def test_quantities_read_back_as_they_were_written(value, dimension):
    assert parse(write(value, dimension), dimension) == value


UNITS = {
    "length": {"um": 1e-3, "mm": 1, "m": 1e3, "inch": 25.4},
    "time": {"ms": 1e-3, "s": 1, "min": 60},
    "force": {"mN": 1e-3, "N": 1, "kN": 1e3},
    "mass": {"g": 1e-3, "kg": 1},
    "stress": {"Pa": 1e-6, "kPa": 1e-3, "MPa": 1, "N/mm^2": 1},
    "stiffness": {"N/m": 1e-3, "N/mm": 1},
    "voltage": {"V": 1e-3, "kV": 1},
    "charge": {"nC": 1e-3, "uC": 1, "C": 1e6},
    "electric field": {"V/m": 1e-6, "MV/m": 1, "V/um": 1, "kV/mm": 1},
}


@given(st.floats(-1e6, 1e6), st.sampled_from([(d, u) for d in UNITS for u in UNITS[d]]))
def test_units_convert_by_their_factor(value, which):
    dimension, unit = which
    factor = UNITS[dimension][unit]
    assert parse(f"{value!r} {unit}", dimension) == pytest.approx(value * factor, rel=1e-14)

"""Resistive electrodes: their constraint map, and their conductances.

An electrode with the sheet resistance rho as mounted, which changes as a^n with the area ratio a,
dissipates per unit of mounted area the power

    1/rho a^(1 - n) E.C^-1 E,

with the metric C of the surface and the gradient E of the potential along it. For a layer of
thickness t the power per unit of volume is 1/t of that.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import ufl

from dealib.config.schema import Config
from dealib.config.sensing import Sensing
from dealib.device.records import PHI, Support
from dealib.errors import ValueAt
from dealib.fem.constraints import ConstraintMap, build, support_dofs
from dealib.fem.domain import Domain, Spaces


def build_map(domain: Domain, spaces: Spaces, config: Config, resistive: bool) -> ConstraintMap:
    """The constraint map of a device (collective).

    Args:
        domain: The mesh.
        spaces: The spaces on it.
        config: The config.
        resistive: Whether the potential of electrodes is prescribed at the contact only.

    Raises:
        ValueAt: If two terminals touch, or an electrode does not reach the contact.
    """
    if not resistive:
        return build(domain, spaces)
    contact, where = _contact(config), ("sensing", "contact")
    if not domain.has(contact):
        raise ValueAt(where, f"the mesh has no boundary {contact!r}")
    map_ = build(domain, spaces, contact)
    for support in _electrodes(domain):
        if not domain.comm.allreduce(int(support.where in map_.contacted)):
            whose = repr(support.port) if support.port else "ground"
            told = f"the electrode of terminal {whose} does not reach {contact!r}"
            raise ValueAt(where, told)
    return map_


def _contact(config: Config) -> str:
    laminate = config.device.laminate
    contact = config.sensing.contact or (laminate and laminate.base.ends[-1])
    assert contact
    return contact


def _electrodes(domain: Domain) -> Iterator[Support]:
    """Supports of the potential that the mesh has."""
    for support in domain.device.supports:
        if support.quantity == PHI and domain.has(support.where):
            yield support


def electrode_dofs(domain: Domain, spaces: Spaces) -> Iterator[tuple[str, Any]]:
    """Port of each electrode, '' for ground, and the degrees of freedom of its potential."""
    for support in _electrodes(domain):
        yield support.port, support_dofs(domain, spaces, support)


def power(problem: Any) -> Any:
    """The bilinear form of the conductances.

    Args:
        problem: A `fem.potential.Problem`.
    """
    W, device, k = problem.spaces.W, problem.device, problem.kinematics
    one, other = (
        k.nominal_field(ufl.split(f(W))[1]) for f in (ufl.TestFunction, ufl.TrialFunction)
    )
    sensing, laminate = problem.config.sensing, device.laminate
    layers = laminate.layers if laminate is not None else ()
    thickness = {layer.name: layer.thickness for layer in layers}
    names = [support.where for support in _electrodes(problem.domain)]
    sheets = [name for name in names if name in thickness]
    tags = problem.domain.tagged(tuple((name,) for name in sheets)) if sheets else None
    found = []
    for name in names:
        point = problem.integrals.point if name in sheets else problem.integrals.face
        C = point.F.T * point.F
        if name in sheets:
            normal = device.region(name).normal
            N = ufl.as_vector([1.0 if i == normal else 0.0 for i in range(3)])
            stretched = ufl.det(C) * ufl.dot(N, ufl.inv(C) * N)  # a^2
            inverse, height = ufl.inv(C), thickness[name]
        else:
            N = point.N
            P = ufl.Identity(3) - ufl.outer(N, N)
            flat = P * C * P + ufl.outer(N, N)
            stretched = ufl.det(flat)
            inverse, height = P * ufl.inv(flat) * P, 1.0
        density = ufl.dot(one, inverse * other) * _share(sensing, stretched) / height
        if name in sheets:
            dx = ufl.Measure(
                "dx",
                domain=problem.domain.mesh,
                subdomain_data=tags,
                metadata={"quadrature_degree": problem.spaces.degree},
            )
            found.append(density * k.volume(point.x) * dx(1 + sheets.index(name)))
        else:
            found.append(
                problem.integrals.over_face(name, density, *(r.name for r in device.solids))
            )
    return sum(found[1:], found[0])


def _share(sensing: Sensing, stretched: Any) -> Any:
    """Sheet conductance, 1/Gohm, times the area ratio, at a squared area ratio."""
    assert sensing.sheet_resistance is not None
    power = (1 - sensing.area_exponent) / 2
    return (stretched**power if power else 1.0) / sensing.sheet_resistance

"""Resistive electrodes: potentials of their own, held at the contact alone, and conductances.

A sheet of resistance rho a square as mounted, which grows as (area ratio)^n, conducts

    1/rho a^(1 - n) E.C^-1 E

a unit of its mounted area, with C of the surface, a its area ratio and E the gradient of the
potential along it: twice the power at that potential. Of a layer of thickness t it is 1/t of that a
unit of volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import ufl
from dolfinx.fem import petsc as fem_petsc

from dealib.config.schema import Sensing
from dealib.device.records import PHI
from dealib.errors import ValueAt
from dealib.fem import compat
from dealib.fem.constraints import build
from dealib.fem.pattern import create_matrix
from dealib.fem.potential import Problem
from dealib.fem.system import System, Timings


def resolved(system: System) -> System:
    """The same state, the potential free along the electrodes up to their contact (collective).

    Raises:
        ValueAt: If an electrode does not reach the contact.
    """
    problem = system.problem
    contact = _contact(problem)
    where = ("sensing", "contact")
    domain = problem.domain
    if not domain.has(contact):
        raise ValueAt(where, f"the mesh has no boundary {contact!r}")
    map_ = build(domain, problem.spaces, contact)
    for support in _electrodes(problem):
        if not domain.comm.allreduce(int(support.where in map_.contacted)):
            whose = repr(support.port) if support.port else "ground"
            told = f"the electrode of terminal {whose} does not reach the end {contact!r}"
            raise ValueAt(where, told)
    found = System(replace(problem, constraints=map_, _forms={}), Timings())
    system.expand(system.q)
    map_.restrict(problem.spaces.w, found.q, system.map.port_values(system.q))
    found.ports.update(system.ports)
    return found


def conductance(system: System) -> Any:
    """Conductances between the unknowns of such a system, 1/Gohm (collective)."""
    problem, map_ = system.problem, system.map
    form = compat.form(_power(problem))

    def assemble(matrix: Any) -> None:
        matrix.setLGMap(map_.lgmap(map_.physical), map_.lgmap(map_.columns))
        fem_petsc.assemble_matrix(matrix, form)

    matrix = create_matrix(problem, assemble)
    matrix.zeroEntries()
    assemble(matrix)
    matrix.assemble()
    return matrix


def _contact(problem: Problem) -> str:
    laminate = problem.device.laminate
    assert laminate is not None
    contact = problem.config.sensing.contact or laminate.base.ends[-1]
    assert contact is not None
    return contact


def _electrodes(problem: Problem) -> Iterator[Any]:
    """Supports of the potential that the mesh has."""
    for support in problem.device.supports:
        if support.quantity == PHI and problem.domain.has(support.where):
            yield support


def _power(problem: Problem) -> Any:
    """The bilinear form of the conductances."""
    W, device, k = problem.spaces.W, problem.device, problem.kinematics
    one, other = (
        k.nominal_field(ufl.split(f(W))[1]) for f in (ufl.TestFunction, ufl.TrialFunction)
    )
    sensing, laminate = problem.config.sensing, device.laminate
    assert laminate is not None
    thickness = {layer.name: layer.thickness for layer in laminate.layers}
    names = [support.where for support in _electrodes(problem)]
    layers = [name for name in names if name in thickness]
    tags = problem.domain.tagged(tuple((name,) for name in layers)) if layers else None
    found = []
    for name in names:
        point = problem.point if name in layers else problem.face
        C = point.F.T * point.F
        if name in layers:
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
        if name in layers:
            dx = ufl.Measure(
                "dx",
                domain=problem.domain.mesh,
                subdomain_data=tags,
                metadata={"quadrature_degree": problem.degree},
            )
            found.append(density * k.volume(point.x) * dx(1 + layers.index(name)))
        else:
            found.append(problem.over_face(name, density, *(r.name for r in device.solids)))
    return sum(found[1:], found[0])


def _share(sensing: Sensing, stretched: Any) -> Any:
    """Conductance a square at a squared area ratio."""
    assert sensing.sheet_resistance is not None
    power = (1 - sensing.area_exponent) / 2
    return (stretched**power if power else 1.0) / sensing.sheet_resistance

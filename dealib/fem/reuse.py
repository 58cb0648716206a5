"""Reuses the solver of one case for the next, if they differ in numbers only.

Moduli, thicknesses and nodal coordinates are constants in the equations. A case with the same cells
and the same equations as the one before takes over its spaces, its compiled forms, its matrix and
the ordering of its factorisation, and starts from zero as it would with new ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from dealib.arrays import Array
from dealib.config.follow import crossed
from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.gmsh_model import gmsh_model
from dealib.device.gmsh_model import save as write_mesh
from dealib.device.kinematics import Kinematics
from dealib.fem.domain import Domain, build_domain
from dealib.fem.groups import Group
from dealib.fem.newton import Newton
from dealib.fem.potential import Problem
from dealib.fem.problem import EnergyTerms, groups_of, problem_on
from dealib.fem.timings import Timings
from dealib.materials.law import Law

_MOST = 50_000  # unknowns above which set-up is a small part of the time and takes much memory
_ON_AXIS = 1e-9  # distance from the axis over the span

Places = dict[str, Any]


class Reuse:
    """Gives each case a solver: that of the previous case if it fits, otherwise a new one."""

    def __init__(self) -> None:
        self._kept: _Kept | None = None

    def newton(self, config: Config, comm: MPI.Comm, mesh_file: Path | None = None) -> Newton:
        """A solver at the start of a case; the previous one must not be used any more.

        Args:
            config: The config.
            comm: MPI communicator; solvers are kept only if it has one rank.
            mesh_file: Where to write the mesh, if anywhere.
        """
        if comm.size > 1 or not _can(config):
            self._kept = None
            problem = problem_on(build_domain(config, comm, mesh_file), config)
            return Newton(problem, Timings(), symmetric=not crossed(config.program))
        with gmsh_model(config) as gmsh:
            if mesh_file is not None:
                write_mesh(gmsh, mesh_file)
            drawn = _Drawn.of(gmsh.model)
            if self._kept is not None and self._kept.take(config, drawn):
                return self._kept.newton
            self._kept = None
            domain = Domain.from_gmsh(gmsh.model, comm, config.device)
        newton = Newton(problem_on(domain, config), Timings(), not crossed(config.program))
        if newton.system.q.size <= _MOST:
            self._kept = _Kept.of(newton, drawn)
        return newton


def _can(config: Config) -> bool:
    """Whether constants and functions are the whole state of a config's problem."""
    rigid = any(port.rigid for port in config.device.ports)
    return config.physics.wrinkling == "taut" and not (config.sensing.charging or rigid)


@dataclass(frozen=True)
class _Drawn:
    """A mesh as Gmsh has it.

    Attributes:
        nodes: Coordinates in the order of their numbers, (nodes, 3), mm.
        cells: All other data of the mesh.
    """

    nodes: Array
    cells: tuple[Any, ...]

    @classmethod
    def of(cls, model: Any) -> _Drawn:
        """The mesh of the current Gmsh model."""
        tags, xyz, _ = model.mesh.getNodes()
        found: list[Any] = [tags]
        for group in model.getPhysicalGroups():
            entities = model.getEntitiesForPhysicalGroup(*group)
            found += [(*group, model.getPhysicalName(*group)), entities]
            for entity in entities:
                for parts in model.mesh.getElements(group[0], entity):
                    found += parts if isinstance(parts, list) else [parts]
        return cls(xyz.reshape(-1, 3)[np.argsort(tags)], tuple(found))

    def same_cells(self, other: _Drawn) -> bool:
        """Whether another mesh differs in nodal coordinates only."""
        return len(self.cells) == len(other.cells) and all(
            np.array_equal(a, b) for a, b in zip(self.cells, other.cells, strict=True)
        )


@dataclass(frozen=True)
class _Kept:
    """A solver, and the data that tell whether it fits another config.

    Attributes:
        newton: The solver.
        drawn: Its mesh.
        kind: The data for which its equations are compiled, by place (see `_anatomy`).
        at_rest: Initial values of the functions in the equations.
    """

    newton: Newton
    drawn: _Drawn
    kind: Places
    at_rest: list[Array]

    @classmethod
    def of(cls, newton: Newton, drawn: _Drawn) -> _Kept | None:
        """Keep a solver before it has solved anything; None if that is not possible."""
        problem = newton.system.problem
        nodes = drawn.nodes[problem.domain.drawn_nodes]
        kind, constants = _anatomy(problem)
        constants_read, functions = problem.data
        found = {id(c) for c in constants.values()}
        found |= {id(sheet.field) for _, sheet in problem.sheets}  # set from the state
        if newton.iterative or not np.array_equal(nodes, problem.domain.mesh.geometry.x):
            return None
        if not {id(c) for c in constants_read} <= found:
            return None
        return cls(newton, drawn, kind, [f.x.array.copy() for f in functions])

    def take(self, config: Config, drawn: _Drawn) -> bool:
        """Start anew with the numbers of another config; returns whether the solver fits it."""
        newton, problem = self.newton, self.newton.system.problem
        own, domain = problem.config, problem.domain
        if not (newton.usable and _settings(config) == _settings(own)):
            return False
        if _names(config.device) != _names(domain.device) or not drawn.same_cells(self.drawn):
            return False
        x = drawn.nodes[domain.drawn_nodes]
        if not np.array_equal(_on_axis(x), _on_axis(domain.mesh.geometry.x)):
            return False
        there = Domain(config.device, *(getattr(domain, f.name) for f in fields(domain)[1:]))
        groups = groups_of(there, config)
        parts = EnergyTerms.of(there, config, problem.spaces, groups, problem.terms, problem.peaks)
        kind, numbers = _anatomy(SimpleNamespace(**vars(parts), groups=groups, domain=there))
        if kind != self.kind:
            return False
        for place, constant in _anatomy(problem)[1].items():
            constant.value = numbers[place].value
        for function, values in zip(problem.data[1], self.at_rest, strict=True):
            function.x.array[:] = values
        domain.mesh.geometry.x[:] = x
        problem.restart(config, [g.sheet.thickness for g in groups if g.sheet is not None])
        newton.restart()
        return True


def _on_axis(x: Array) -> Any:
    return np.abs(x[:, 0]) < _ON_AXIS * np.ptp(x[:, 0])


def _settings(config: Config) -> tuple[Any, ...]:
    """Further settings on which problem and solver depend."""
    paths = [s.follow.pair for s in config.program if s.follow is not None]
    order = config.mesh.order
    return config.physics, config.solver.linear, config.output.modes > 0, paths, order


def _names(device: Device) -> tuple[Any, ...]:
    """Regions, ports and supports of a device without numbers."""
    ports = [(p.kind.name, p.name, p.on, p.along, p.floating) for p in device.ports]
    regions = [(r.name, r.material, r.normal, r.air) for r in device.regions]
    return _space(device.kinematics), ports, regions, device.supports, device.laminate is None


def _space(k: Kinematics) -> tuple[Any, ...]:
    return type(k).__name__, k.space, k.axes, k.components, k.lies


def _anatomy(problem: Any) -> tuple[Places, Places]:
    """Structure and constants of the energies of a problem, or of `EnergyTerms`, both by place.

    A place is a path of attributes and indices such as '.energies.0.2.parameters.c10'.
    """
    groups: list[Any] = []
    for g in problem.groups:
        assert isinstance(g, Group)
        sheet = None if g.sheet is None else (g.sheet.area, g.sheet.between)
        groups.append((g.name, g.material, g.regions, g.normal, g.slot, g.prestretch, sheet))
    motion = problem.mesh_motion if isinstance(problem, Problem) else problem.motion
    symbolic, names = problem.domain.symbolic, ("multiple", "offset")
    parts: dict[str, Any] = {
        "groups": groups,
        "energies": [problem.elastic, problem.electric, motion, problem.branches, problem.loads],
        "values": {name: value.ufl_operands[0] for name, value in problem.values.items()},
        "density": problem.density,
        "space": [getattr(symbolic, name, None) for name in names],
    }
    kind, constants = Places(), Places()
    for place, leaf in _leaves(parts):
        if isinstance(leaf, fem.Constant):
            constants[place], leaf = leaf, leaf.ufl_shape
        kind[place] = leaf
    return kind, constants


def _leaves(part: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """All values of which a part consists, with their places."""
    inner: Mapping[Any, Any]
    if isinstance(part, fem.Constant) or part is None or isinstance(part, (str, int, float)):
        yield place, part
        return
    if isinstance(part, Expr):  # a function of the state or of a port's value
        yield place, type(part).__name__
        return
    if isinstance(part, Kinematics):
        yield place, _space(part)
        return
    if isinstance(part, np.ndarray):
        yield place, part.tolist()
        return
    yield f"{place} is", type(part).__name__
    if isinstance(part, Law):
        inner = part.fixed
    elif is_dataclass(part):
        inner = {f.name: getattr(part, f.name) for f in fields(part)}
    elif isinstance(part, SimpleNamespace):
        inner = vars(part)
    else:
        inner = part if isinstance(part, Mapping) else dict(enumerate(part))
    for name, value in inner.items():
        yield from _leaves(value, f"{place}.{name}")

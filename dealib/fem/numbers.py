"""The numbers of a problem, which alone distinguish it from that of a slightly changed config.

Equations are compiled for a kind of problem. Moduli, thicknesses and nodal coordinates are numbers
in them: with the numbers of another config the same problem gives that config's residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.drawing import Drawing
from dealib.errors import ConfigError, DealibError
from dealib.fem.potential import Problem
from dealib.fem.problem import problem_on

_OUTSIDE = ("program", "limits", "sensing", "stop_when")  # sections that no equation reads


@dataclass
class Numbers:
    """All data of a problem besides its equations.

    Attributes:
        config: The config.
        device: Its device.
        nodes: Coordinates of the mesh's nodes on this rank, mm.
        constants: Values of the constants.
        values: Values of the functions in the equations, with the internal variables.
        thicknesses: Thicknesses of the layers of a sheet, mm.
        platforms: Rigid mounts.
        reform: See `Problem`.
    """

    config: Config
    device: Device
    nodes: Array
    constants: list[Array]
    values: list[Array]
    thicknesses: list[float]
    platforms: tuple[Any, ...]
    reform: Callable[[], None] | None

    @classmethod
    def of(cls, problem: Problem) -> Numbers:
        """The current numbers of a problem."""
        constants, functions = problem.data
        return cls(
            config=problem.config,
            device=problem.domain.device,
            nodes=problem.domain.mesh.geometry.x.copy(),
            constants=[np.array(c.value) for c in constants],
            values=[f.x.array.copy() for f in functions],
            thicknesses=[sheet.thickness for _, sheet in problem.sheets],
            platforms=problem.constraints.platforms,
            reform=problem.reform,
        )

    def put(self, problem: Problem) -> None:
        """Set them in a problem."""
        constants, functions = problem.data
        problem.config, problem.domain.device = self.config, self.device
        problem.domain.mesh.geometry.x[:] = self.nodes
        for constant, number in zip(constants, self.constants, strict=True):
            constant.value = number
        for function, array in zip(functions, self.values, strict=True):
            function.x.array[:] = array
        for (_, sheet), thickness in zip(problem.sheets, self.thicknesses, strict=True):
            sheet.thickness = thickness
        problem.constraints.platforms, problem.reform = self.platforms, self.reform

    def take(self, problem: Problem) -> None:
        """Update them from a problem whose load program has changed them."""
        constants, functions = problem.data
        self.constants = [np.array(c.value) for c in constants]
        self.values = [f.x.array.copy() for f in functions]
        self.reform = problem.reform

    @contextmanager
    def placed(self, problem: Problem) -> Iterator[None]:
        """A context in which a problem has these numbers; changes in it are kept here."""
        before = Numbers.of(problem)
        self.put(problem)
        try:
            yield
        finally:
            self.take(problem)
            before.put(problem)


class Sources:
    """Finds the numbers of configs that differ slightly from that of a problem (collective).

    Args:
        problem: The problem, before it is solved.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._at_rest = problem, Numbers.of(problem)
        self._drawing: Drawing | None = None

    def of(self, config: Config) -> Numbers:
        """The numbers of a config.

        Raises:
            ConfigError: If its problem has other equations or another mesh.
        """
        problem, own = self._problem, self._problem.config
        if config.model_copy(update={key: getattr(own, key) for key in _OUTSIDE}) == own:
            return replace(self._at_rest, config=config)
        nodes = self._nodes(config)
        domain = replace(problem.domain, device=config.device)
        x = domain.mesh.geometry.x
        x[:] = nodes
        try:
            found = Numbers.of(problem_on(domain, config, problem.spaces))
        finally:
            x[:] = self._at_rest.nodes
        for one, other in zip(_shapes(found), _shapes(self._at_rest), strict=True):
            if one != other:
                raise ConfigError("a small change of it changes the equations themselves")
        laws = {name: material.fixed for name, material in config.materials.items()}
        if any(problem.config.materials[name].fixed != law for name, law in laws.items()):
            raise ConfigError("it is an exponent, for which the equations are compiled")
        return found

    def _nodes(self, config: Config) -> Array:
        """Coordinates of the mesh's nodes on this rank for a config, (nodes, 3), mm."""
        own, known = self._problem.config, self._at_rest.nodes
        if (config.geometry, config.terminals) == (own.geometry, own.terminals):
            return known
        if own.mesh.file is not None:
            raise ConfigError("the shape is that of mesh.file, not of this number")
        if config.mesh_file is not None:
            return known
        comm, index = self._problem.domain.comm, self._problem.domain.drawn_nodes
        if self._drawing is None:
            self._drawing = _drawn(own, comm)
        moved = self._drawing.moved(_drawn(config, comm))
        drawn = self._drawing.nodes[index]
        same = len(known) == len(index) and np.allclose(drawn, known, rtol=0, atol=1e-12)
        if not comm.allreduce(bool(same), op=MPI.LAND):
            raise ConfigError("Gmsh gives the mesh other nodes when it is made again")
        return np.asarray(moved[index])


def _shapes(numbers: Numbers) -> tuple[list[Any], list[Any]]:
    return [c.shape for c in numbers.constants], [v.shape for v in numbers.values]


def _drawn(config: Config, comm: MPI.Comm) -> Drawing:
    """The mesh of a config on all ranks (collective)."""
    found: Drawing | DealibError | None = None
    if comm.rank == 0:
        try:
            found = Drawing.of(config)
        except DealibError as error:
            found = error
    found = comm.bcast(found, root=0)
    if isinstance(found, DealibError):
        raise found
    assert found is not None
    return found

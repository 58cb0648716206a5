"""Resistive electrodes in small-signal spectra: the system with their potentials as unknowns.

Their potential is prescribed at the contact only. See `fem.charging` for charging in time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from dolfinx.fem import petsc as fem_petsc

from dealib.fem.electrodes import build_map
from dealib.fem.pattern import create_matrix
from dealib.fem.system import System
from dealib.fem.timings import Timings


def resolved(system: System) -> System:
    """The same state with the potential of electrodes free except at the contact (collective).

    Raises:
        ValueAt: If an electrode does not reach the contact.
    """
    problem = system.problem
    map_ = build_map(problem.domain, problem.spaces, problem.config, resistive=True)
    found = System(replace(problem, constraints=map_, charging=False, _forms={}), Timings())
    system.expand(system.q)
    map_.restrict(problem.spaces.w, found.q, system.map.port_values(system.q))
    found.ports.update(system.ports)
    return found


def conductance(system: System) -> Any:
    """Conductances between the unknowns of such a system as a matrix, 1/Gohm (collective)."""
    problem, map_ = system.problem, system.map
    form = problem.form("conductance")

    def assemble(matrix: Any) -> None:
        matrix.setLGMap(map_.lgmap(map_.physical), map_.lgmap(map_.columns))
        fem_petsc.assemble_matrix(matrix, form)

    matrix = create_matrix(problem, assemble)
    matrix.zeroEntries()
    assemble(matrix)
    matrix.assemble()
    return matrix

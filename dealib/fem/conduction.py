"""Resistive electrodes in small-signal spectra: the system with their potentials as unknowns.

Their potential is prescribed at the contact only. See `fem.charging` for charging in time.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from dealib.fem.electrodes import build_map
from dealib.fem.pattern import add_form, create_matrix
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
    assemble = partial(add_form, system.problem, "conductance")
    matrix = create_matrix(system.problem, assemble)
    matrix.zeroEntries()
    assemble(matrix)
    matrix.assemble()
    return matrix

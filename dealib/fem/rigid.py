"""Finds rigid motions of the whole device that are not held, for which the tangent is singular."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.device.kinematics import Kinematics
from dealib.device.records import MOUNT, TURN
from dealib.fem.layout import Layout
from dealib.fem.problem import Problem

_HELD = 1e-9  # smallest over largest eigenvalue of the constraints on rigid motions


def unheld(problem: Problem, layout: Layout, loaded: set[str]) -> str:
    """A motion that is not held, such as 'along X'; empty if all are held (collective).

    Args:
        problem: The problem.
        layout: Its layout.
        loaded: Mounts whose position is not prescribed; their parts still move as one.
    """
    names = _names(problem.kinematics)
    map_, ports = problem.constraints, {p.name for p in problem.device.of(MOUNT) if not p.rigid}
    first = {map_.ports[name]: name for name in ports}
    held, apart = np.zeros((len(names), len(names))), dict[str, list[Array]]()
    held += _by_platforms(problem, names, loaded)
    platforms = np.concatenate([np.empty(0, int), *(p.dofs for p in map_.platforms)])
    for dofs, values in _motions(problem, layout):
        columns = map_.columns[dofs]
        fixed = values[(columns < 0) & ~np.isin(dofs, platforms)]
        held += fixed.T @ fixed
        for number, name in first.items():
            part = values[columns == number]
            if name in loaded:
                apart.setdefault(name, []).append(part)
            else:
                held += part.T @ part
    for name in sorted(loaded & ports):
        mine = np.concatenate(apart[name])
        count = problem.domain.comm.allreduce(len(mine))
        mean = problem.domain.comm.allreduce(mine.sum(axis=0)) / max(count, 1)
        held += (mine - mean).T @ (mine - mean)
    total = problem.domain.comm.allreduce(held, op=MPI.SUM)
    values, vectors = np.linalg.eigh(total)
    if values[0] > _HELD * max(values[-1], 1e-300):
        return ""
    return names[int(np.abs(vectors[:, 0]).argmax())]


def _by_platforms(problem: Problem, names: list[str], loaded: set[str]) -> Array:
    """Constraints of rigid mounts on the motions, (motions, motions), on rank 0.

    A port with a prescribed force or moment leaves its motion free.
    """
    held = np.zeros((len(names), len(names)))
    if problem.domain.comm.rank > 0:
        return held
    for port in problem.device.ports:
        if not port.rigid or port.name in loaded:
            continue
        motion = np.array([float(name.endswith(port.along)) for name in names])
        kind = "about" if port.kind == TURN else "along"
        row = motion * [name.startswith(kind) for name in names]
        if port.kind == MOUNT:  # turns of the whole device move the mount's centre too
            (platform,) = (p for p in problem.constraints.platforms if port.name in p.ports)
            centre = platform.centre / problem.domain.sizes.span
            turns = _turns(centre[None])[0][:, problem.kinematics.axes.index(port.along)]
            row[len(names) - len(turns) :] += turns
        held += np.outer(row, row)
    return held


def _names(kinematics: Kinematics) -> list[str]:
    if kinematics.revolved:
        return ["along Z"]
    axes = kinematics.axes
    turns = ["about Y"] if len(axes) == 2 else [f"about {axis}" for axis in axes]
    return [*(f"along {axis}" for axis in axes), *turns]


def _motions(problem: Problem, layout: Layout) -> Iterator[tuple[Any, Array]]:
    """This rank's degrees of freedom of each axis, and rigid motions there, (dofs, motions)."""
    kinematics, axes = problem.kinematics, problem.kinematics.dim
    x = layout.nodes.reshape(-1, axes) / problem.domain.sizes.span
    for k, dofs in enumerate(layout.displacements):
        flat, index = np.unique(dofs.ravel(), return_index=True)
        mine = flat < problem.spaces.W.dofmap.index_map.size_local
        at = x[index[mine]]
        if kinematics.revolved:
            motions = np.full((len(at), 1), float(k == 1))
        else:
            shifts = np.tile(np.eye(axes)[k], (len(at), 1))
            motions = np.column_stack([shifts, _turns(at)[:, :, k]])
        yield flat[mine], motions


def _turns(x: Array) -> Array:
    """Displacements of small rotations at points, (points, rotations, axes)."""
    if x.shape[1] == 2:
        return np.stack([-x[:, 1], x[:, 0]], axis=-1)[:, None]
    return np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=1)

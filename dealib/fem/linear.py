"""The linear solver: direct or iterative, with the air's mesh as a block; and the inertia."""

from __future__ import annotations

import weakref
from typing import Any

from petsc4py import PETSc

from dealib.config.linear import choose, machine_memory
from dealib.errors import ValueAt
from dealib.fem.compat import HAS_HYPRE
from dealib.fem.multigrid import EVENT, Multigrid
from dealib.fem.system import System

_MUMPS: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_7": 5,  # METIS; PORD where MUMPS was built without it
    "mat_mumps_icntl_14": 60,  # room for pivoting, per cent
}
_DEFINITE: dict[str, Any] = {  # quasi-definite tangents need neither
    "mat_mumps_icntl_8": 0,  # scaling
    "mat_mumps_cntl_1": 0.0,  # pivoting
}
_BLOCKS: dict[str, Any] = {
    "ksp_type": "gcr",  # mostly one sweep; more where the field fringes far into the air
    "ksp_rtol": 1e-3,  # Newton corrects what this leaves
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "multiplicative",
}
_ITERATIVE: dict[str, Any] = {
    "ksp_type": "fgmres",
    "ksp_gmres_restart": 150,
    "ksp_max_it": 300,
    "ksp_rtol": 1e-6,
}
_FACTORISATION = (  # PETSc's events; the last one takes the blocks out of the tangent
    *("MatLUFactorSym", "MatLUFactorNum", "MatCholFctrSym", "MatCholFctrNum"),
    *("MatSolve", "MatCreateSubMats"),
)
_INERTIA_OPTIONS: dict[str, Any] = {
    "mat_mumps_icntl_7": 5,
    "mat_mumps_icntl_13": 1,  # no ScaLAPACK at the root, which counts no negative pivots
    "mat_mumps_icntl_24": 1,  # zero pivots are found and counted
}
_PREFIX = "dealib_inertia_"


def set_linear_solver(solver: Any, system: System, symmetric: bool) -> str:
    """Set up the linear solver: LDL^T, LU if the tangent is not symmetric, or multigrid.

    `dealib.config.linear` chooses between a direct and an iterative solver.

    The air's mesh follows the body, which it affects only through the field in the air. So the
    tangent is nearly block triangular, and one Gauss-Seidel sweep over two blocks, first the body
    with the field and then the air's mesh, is nearly its inverse. Each block is factorised.

    In a stable state the tangent is positive definite in the displacement and negative definite in
    the potential. Such a matrix has an LDL^T in any order of its unknowns (R. J. Vanderbei, SIAM J.
    Optim. 5 (1995) 100), so that no pivoting is needed. This does not hold in the mixed form, nor
    in the unstable states to which followed branches and watched modes lead.

    Returns:
        Description of the solver for the log.

    Raises:
        ValueAt: If the memory is too small for a factorisation.
    """
    problem = system.problem
    config = problem.config
    choice = choose(config, int(system.q.size), problem.domain.sizes)
    told = f"about {choice.memory / 1e9:.2g} GB{choice.note and '; ' + choice.note}"
    if choice.iterative and HAS_HYPRE:
        multigrid = Multigrid(system)
        _use(solver, "dealib_iterative_", _ITERATIVE)
        pc = solver.getPC()
        pc.setType("python")
        pc.setPythonContext(multigrid)
        # PETSc cannot call Python any more when it ends itself, after Python
        weakref.finalize(system, pc.setType, "none")
        return f"FGMRES with multigrid, {told}"
    if config.solver.linear == "iterative":
        raise ValueAt(("solver", "linear"), "this PETSc was built without hypre: choose auto")
    if choice.memory > machine_memory():  # for a mesh file this is not known earlier
        raise ValueAt(
            ("solver", "linear"),
            f"{system.q.size:,} unknowns need {told} of memory with a factorisation, and this "
            f"machine has {machine_memory() / 1e9:.3g} GB: choose a coarser mesh",
        )
    whole = config.solver.linear == "lu"
    kind, body = "lu", _MUMPS | {"pc_type": "lu"}
    if symmetric and problem.coupling.symmetric and not whole:
        kind, body = "ldl", _MUMPS | {"pc_type": "cholesky"}
        leaves = config.output.modes or any(s.follow is not None for s in config.program)
        if config.physics.formulation == "displacement" and not leaves:
            kind, body = "definite", body | _DEFINITE
    name = {"lu": "LU"}.get(kind, "LDL^T")
    if whole or not problem.mesh_motion:
        _use(solver, f"dealib_{kind}_", body)
        return f"{name} by MUMPS, {told}"
    air = _MUMPS | _DEFINITE | {"pc_type": "cholesky"}
    blocks = {f"fieldsplit_body_{k}": v for k, v in body.items()}
    blocks |= {f"fieldsplit_air_{k}": v for k, v in air.items()}
    _use(solver, f"dealib_{kind}_air_", _BLOCKS | blocks)
    rows = system.map
    start, end = system.matrix.getOwnershipRange()
    count = len(rows.numbers("air mesh"))  # the first ones of each rank
    air_mesh = PETSc.IS().createStride(count, start, 1, comm=rows.comm)
    rest = PETSc.IS().createStride(end - start - count, start + count, 1, comm=rows.comm)
    pc = solver.getPC()
    pc.setType("fieldsplit")
    pc.setFieldSplitIS(("body", rest), ("air", air_mesh))
    return f"{name} by MUMPS, the air's mesh apart, {told}"


def _use(solver: Any, prefix: str, options: dict[str, Any]) -> None:
    """Set options of a solver, under a prefix of their own.

    PETSc keeps options for the process and reads some only at the first factorisation, so that no
    solver with other options may have the same prefix.
    """
    set_options(prefix, options)
    solver.setOptionsPrefix(prefix)


def factorisation_seconds() -> float:
    """Time of this process in factorisations and back-substitutions, or in multigrid."""
    events = (*map(PETSc.Log.Event, _FACTORISATION), EVENT)
    return float(sum(event.getPerfInfo()["time"] for event in events))


class Factor:
    """LDL^T with pivoting of a symmetric matrix, which may be indefinite.

    Attributes:
        inertia: Numbers of its negative, zero and positive eigenvalues.
        solve: Solves with it: right-hand side, solution.
    """

    def __init__(self, matrix: Any) -> None:
        set_options(_PREFIX, _INERTIA_OPTIONS)
        solver = PETSc.PC().create(matrix.comm)
        solver.setOptionsPrefix(_PREFIX)
        solver.setType("cholesky")
        solver.setFactorSolverType("mumps")
        solver.setOperators(matrix)
        solver.setUp()
        negative, zero, positive = solver.getFactorMatrix().getInertia()
        self.inertia = int(negative), int(zero), int(positive)
        self.solve = solver.apply


def fixed_tangent(system: System) -> Any:
    """A copy of the tangent at the current q, with the air's mesh held in place.

    Prescribed ports and displacements of the air's mesh, which affect the body by discretisation
    errors only, have rows of the identity.

    Raises:
        ValueError: If the coupling has no potential, so that its tangent is not symmetric.
    """
    if not system.problem.coupling.symmetric:
        raise ValueError("the tangent has an inertia only if physics.coupling is energy")
    with system.still():
        system.residual(system.q, system.residual_vector)
        system.tangent(system.matrix)
        matrix = system.matrix.copy()
    matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    matrix.zeroRowsColumns(system.map.numbers("air mesh"), 1.0)
    return matrix


def set_options(prefix: str, options: dict[str, Any]) -> None:
    """Put options into PETSc's database."""
    known = PETSc.Options()
    known["options_left"] = "no"  # a run that is stopped early has not used all
    for key, value in options.items():
        known[prefix + key] = value

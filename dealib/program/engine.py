"""The discrete device with its solver and the progress of its load program, for the stages."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.config.follow import crossed
from dealib.config.schema import Config
from dealib.device.records import MOUNT, TERMINAL, TURN, not_held
from dealib.errors import ConfigError, ValueAt, anew, by_caller
from dealib.fem.charging import Charging
from dealib.fem.constraints import FIELDS
from dealib.fem.films import field_normals
from dealib.fem.inertia import Inertia
from dealib.fem.layout import Layout
from dealib.fem.modes import Eigenmodes
from dealib.fem.newton import Newton
from dealib.fem.problem import build_problem
from dealib.fem.rigid import unheld
from dealib.fem.timings import Timings
from dealib.fem.viscous import Viscosity
from dealib.program.flows import Flows
from dealib.program.inputs import Drive, law, rest
from dealib.program.leaps import Leaps
from dealib.program.predictor import Predictor, remembered
from dealib.program.progress import ProgramState
from dealib.results.checkpoint import Checkpoint


class Engine:
    """A discrete device, its solver, and how far its program has come.

    Attributes:
        config: The config.
        comm: MPI communicator.
        timings: Seconds by phase.
        problem: The total potential.
        layout: Its nodal values.
        viscosity: State of the Maxwell branches, if there are some.
        newton: The solver.
        inertia: Velocities and accelerations, if a stage is dynamic.
        predictor: Initial guesses for the solver.
        leaps: Refuses states that no motion leads to.
        progress: How far the program has come.
        normals: Directions across films that are no layers, at the local cells' Gauss points.

    Args:
        config: The config.
        comm: MPI communicator.
        mesh_file: Where to write the mesh in Gmsh's format, if anywhere.
        newton: A solver of the same problem that is shared with other engines.
    """

    def __init__(
        self,
        config: Config,
        comm: MPI.Comm,
        mesh_file: Path | None = None,
        newton: Newton | None = None,
    ) -> None:
        self.config, self.comm = config, comm
        self.timings = newton.timings if newton else Timings()
        start = time.perf_counter()
        self.problem = newton.system.problem if newton else build_problem(config, comm, mesh_file)
        self.layout = Layout.of(self.problem)
        self.timings["mesh"] += time.perf_counter() - start
        remembers = any(m.memory for m in config.solids.values())
        self.viscosity = Viscosity(self.problem, self.layout) if remembers else None
        symmetric = not crossed(config.program)
        self.newton = newton or Newton(self.problem, self.timings, symmetric)
        system = self.newton.system
        self.inertia = Inertia(self.problem, system.ports) if config.moves else None
        self.predictor = Predictor(
            config.solver.predictor_order,
            retrace=self.viscosity is None and not config.moves and system.charging is None,
            memory=remembered(system.q.size),
            signs=self._signs(),
        )
        self.leaps = Leaps(self.newton, self.layout)
        self.progress = ProgramState(drives=rest(self.problem.device))
        self.normals = None
        if self.problem.device.laminate is None:  # a mesh file does not give films a normal
            self.normals = field_normals(self.newton, self.layout)
            self.layout.add_normals(self.normals)

    def _signs(self) -> Any:
        """-1 for the unknowns that change sign with all voltages, 1 for the others (collective)."""
        system, device = self.newton.system, self.problem.device
        signs = system.q.duplicate()
        signs.set(1.0)
        signs.array[: len(system.map.field)][system.map.field == FIELDS.index("potential")] = -1.0
        for port in device.of(TERMINAL):
            system.map.set_port(signs, port.name, -1.0)
        signs.assemble()
        return signs

    @property
    def drives(self) -> list[Drive]:
        """The drives of all ports."""
        return [drive for drives in self.progress.drives.values() for drive in drives]

    def apply(self, at: float) -> tuple[Any, ...]:
        """Set the ports' equations at a time in the stage, in cycles.

        Returns:
            Label and value of each drive, one after the other.
        """
        for port, drives in self.progress.drives.items():
            self.newton.system.ports[port] = law(drives, at)
        return tuple(x for d in self.drives for x in (d.label, d.at(at)))

    @property
    def clocks(self) -> list[Viscosity | Inertia | Charging | Flows]:
        """The parts of the state that are integrated in time in the current stage."""
        flows = self._flows if self._flows.filled else None
        known = (self.viscosity, self.newton.system.inertia, self.newton.system.charging, flows)
        return [clock for clock in known if clock is not None]

    @property
    def _flows(self) -> Flows:
        p, problem = self.progress, self.problem
        system, least = self.newton.system, problem.domain.sizes.volume
        laws = system.ports
        return Flows(problem.device, p.drives, p.through, laws, lambda: system.values, least)

    def begin(self, duration: float) -> None:
        """Prepare a step from the last converged state, in s."""
        self._flows.begin(duration)
        system = self.newton.system
        if system.charging is not None:
            system.expand(system.q)  # a failed step may have left the problem at another state
            system.charging.begin(duration)
        if self.viscosity is not None:
            self.viscosity.begin(duration)
        if system.inertia is not None:
            system.begin(duration)

    def enter(self, dynamic: bool) -> None:
        """Enter a stage; motion starts from rest, and a quasi-static stage ends it (collective)."""
        system, inertia = self.newton.system, self.inertia
        if inertia is not None:
            if not dynamic or system.inertia is None:
                inertia.rest(system.map.port_values(system.q))
            inertia.enter()
        system.inertia = inertia if dynamic else None

    def in_time(self) -> dict[str, Any]:
        """Arrays of a checkpoint beside the states, on rank 0 (collective).

        Returns:
            'rates' (see `Inertia.gather`; None in a quasi-static stage), 'charges' (see
            `Charging.gather`; None without resistance), and 'slopes', the nodal rates of the
            predictor, (rates, nodes, columns), or None.
        """
        system = self.newton.system
        parts = {"rates": system.inertia, "charges": system.charging}
        found = {name: part and part.gather(self.layout) for name, part in parts.items()}
        slopes = []
        for rate in self.predictor.rates:
            system.map.expand(rate, self.problem.spaces.w, system.values)
            slopes.append(self.layout.gather())
        found["slopes"] = np.array(slopes) if slopes and self.comm.rank == 0 else None
        if slopes or any(part is not None for part in parts.values()):
            system.expand(system.q)
        return found

    def check_held(self, at: float) -> None:
        """Raise `ValueAt` if the whole device could move as a rigid body (collective)."""
        device = self.problem.device
        moved = (*device.of(MOUNT), *device.of(TURN))
        laws = {port.name: law(self.progress.drives[port.name], at) for port in moved}
        loaded = {n for n, found in laws.items() if found.value is None and not found.elements}
        if motion := unheld(self.problem, self.layout, loaded):
            raise ValueAt(("holds",), not_held(motion))

    def port_pairs(self) -> dict[str, tuple[float, float]]:
        """Value and dual of each port at the last residual."""
        system = self.newton.system
        return {
            port.name: (system.values[port.name], port.kind.sign * system.internal[port.name])
            for port in self.problem.device.ports
        }

    def mode_shapes(self, modes: Eigenmodes) -> tuple[Any, Any]:
        """Displacements of modes of the present state on rank 0, (modes, nodes, axes) (collective).

        The longest displacement of each is 1; its largest component is positive.

        Returns:
            The displacements, None elsewhere; and what was divided by, (modes,), on all ranks.
        """
        system, found, scales = self.newton.system, [], []
        for shape in modes.shapes:
            mode = system.q.duplicate()
            mode.array[:] = shape[slice(*mode.getOwnershipRange())]
            system.map.expand(mode, self.problem.spaces.w, system.values)
            nodal = self.layout.gather()
            if nodal is not None:
                u = nodal[:, : self.problem.kinematics.dim]
                scales.append(np.sign(u.flat[np.abs(u).argmax()]) * np.linalg.norm(u, axis=1).max())
                found.append(u / scales[-1])
        system.expand(system.q)
        return np.array(found) if found else None, np.array(self.comm.bcast(scales, root=0))

    def restore(self, saved: Checkpoint) -> None:
        """Restore a saved state (collective).

        Raises:
            ConfigError: If it belongs to another mesh.
        """
        mesh, comm = self.layout.mesh, self.comm
        same = comm.bcast(None if mesh is None else mesh.fingerprint == saved.mesh, root=0)
        if not same:
            raise ConfigError(
                "the checkpoint belongs to another mesh (has mesh.file changed, or Gmsh?); "
                + by_caller(
                    "start anew with --overwrite, or elsewhere with --out",
                    "start anew with overwrite=True, or in another directory",
                )
            )
        system, w = self.newton.system, self.problem.spaces.w
        try:
            self.progress = ProgramState.of(saved.values["progress"])
        except Exception as error:  # the file's content can be anything
            raise ConfigError(f"damaged checkpoint ({error!r}); {anew()}") from None
        self.problem.set_prestretch(1.0)
        count = comm.bcast(len(saved.states), root=0)
        ports, slopes = saved.values["ports"], saved.values["slopes"]

        def reduced(nodal: Any, values: dict[str, float]) -> Any:
            self.layout.scatter(nodal)
            system.map.restrict(w, system.q, values)
            return system.q.copy()

        here = mesh is not None
        of_slopes = saved.beside["slopes"] if here and slopes else [None] * len(slopes)
        ahead = [reduced(*found) for found in zip(of_slopes, slopes, strict=True)]
        ports, of_states = ports[len(ports) - count :], saved.states if here else [None] * count
        known = [reduced(*found) for found in zip(of_states, ports, strict=True)]
        row = self.progress.row or {}
        if self.viscosity is not None and row:
            self.viscosity.restore(saved.beside.get("internal"), row["dissipated_energy_mJ"])
        if system.charging is not None and row:
            system.charging.lost = row["electrode_loss_mJ"]
            kept = saved.beside.get("charges")
            system.charging.restore(self.layout, kept, saved.values["charging"])
            system.expand(system.q)
        if self.inertia is not None and row:
            self.inertia.damped = row.get("damped_energy_mJ", 0.0)
            self.inertia.numerical = row["numerical_dissipation_mJ"]
            if (rates := saved.values["rates"]) is not None:
                at, nodal = system.map.port_values(system.q), saved.beside.get("rates")
                self.inertia.restore(self.layout, nodal, rates, at)
                system.inertia = self.inertia
                system.expand(system.q)
        # states on the way to the pre-stretch, before row 0, are not saved
        predictor = saved.values["predictor"]
        self.predictor.restore(predictor, known, ahead, exact=self.layout.exact)

    def plain(self) -> dict[str, Any]:
        """Plain values of a checkpoint (collective)."""
        map_, moved = self.newton.system.map, self.newton.system.inertia
        charging = self.newton.system.charging
        free = {*self.problem.values, *(port for p in map_.platforms for port in p.ports)}

        def ports(vectors: Iterable[Any]) -> list[dict[str, float]]:
            """Values of the ports that no displacement or potential follows."""
            if not free:
                return [{} for _ in vectors]
            found = map(map_.port_values, vectors)
            return [{name: x for name, x in values.items() if name in free} for values in found]

        return {
            "progress": self.progress.plain(),
            "predictor": self.predictor.plain(),
            "ports": ports(known.q for known in self.predictor.path),
            "slopes": ports(self.predictor.rates),
            "rates": None if moved is None else moved.plain(),
            "charging": None if charging is None else charging.plain(),
        }

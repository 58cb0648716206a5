"""Configs with one number changed, whose states are computed along with those of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dealib.config.schema import Config
from dealib.design.keys import Key, moved
from dealib.errors import ConfigError
from dealib.fem.compat import free
from dealib.fem.numbers import Numbers, Sources
from dealib.program.simulation import Simulation


@dataclass
class Side:
    """A config with one number changed: its numbers in the problem, simulation and history."""

    config: Config
    numbers: Numbers
    simulation: Simulation
    rows: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class DifferencePair:
    """A number with its changed configs: larger and, for central differences, smaller."""

    key: Key
    sides: tuple[Side, ...]


class Neighbours:
    """The changed configs of several numbers (collective).

    Attributes:
        pairs: The numbers with their changed configs.
        left_out: Reason for each key that cannot be changed.

    Args:
        base: The simulation of the unchanged config.
        chosen: The numbers.
        needed: Columns of the histories.
        step: Relative change of a number.
        strict: Whether a key that cannot be changed is an error.
        both: Whether each number is also made smaller, for central differences.

    Raises:
        ConfigError: If `strict` and a key cannot be changed.
    """

    def __init__(
        self,
        base: Simulation,
        chosen: Sequence[Key],
        needed: set[str],
        step: float,
        strict: bool = False,
        both: bool = True,
    ) -> None:
        self._base, self._needed, self.left_out = base, needed, dict[str, str]()
        sources = Sources(base.engine.problem)
        self.pairs: list[DifferencePair] = []
        for key in chosen:
            try:
                signs = (1, -1) if both else (1,)
                sides = tuple(self._side(sources, key, 1 + s * step) for s in signs)
            except ConfigError as error:
                if strict:
                    raise ConfigError(f"{key.name}: {error}") from None
                self.left_out[key.name] = str(error)
                continue
            self.pairs.append(DifferencePair(key, sides))

    def _side(self, sources: Sources, key: Key, factor: float) -> Side:
        base = self._base
        config = moved(base.case.config, {key: factor})
        program = tuple(s.model_copy(update={"stop_when": ()}) for s in config.program)
        config = config.model_copy(update={"program": program, "stop_when": ()})  # those of base
        numbers = sources.of(config)
        with numbers.placed(base.engine.problem):
            simulation = Simulation(
                replace(base.case, config=config),
                base.comm,
                newton=base.engine.newton,
                only=self._needed,
            )
        return Side(config, numbers, simulation)

    def follow(self) -> None:
        """Compute the present state of all changed configs from that of the base."""
        engine = self._base.engine
        problem, newton, system = engine.problem, engine.newton, engine.newton.system
        laws, q, linear, own = dict(system.ports), system.q.copy(), -1, Numbers.of(engine.problem)

        def back() -> None:
            own.put(problem)
            system.ports.update(laws)
            q.copy(system.q)
            system.residual(system.q, system.residual_vector)

        for side in (side for pair in self.pairs for side in pair.sides):
            if system.tangents != linear:  # at first, or after a quantity has assembled a tangent
                back()
                newton.linearise()
                linear = system.tangents
            side.numbers.put(problem)
            side.rows.append(side.simulation.beside(self._base.progress, q).row)
            side.numbers.take(problem)
        back()
        free(self._base.comm)

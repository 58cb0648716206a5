"""Configs with one number changed, which follow a simulation from state to state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dealib.config.schema import Config
from dealib.design.keys import Key, changed
from dealib.errors import ConfigError
from dealib.fem.compat import free
from dealib.fem.numbers import Numbers, Sources
from dealib.program.simulation import Simulation


@dataclass
class Side:
    """A config with one number changed: its numbers, its program, its history."""

    config: Config
    numbers: Numbers
    simulation: Simulation
    rows: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Pair:
    """A number, and the configs in which it is larger, and smaller if there are both."""

    key: Key
    sides: tuple[Side, ...]


class Neighbours:
    """The changed configs, which follow the config itself from state to state (collective).

    Attributes:
        pairs: Of each key.
        left_out: Why others have none, by key.

    Args:
        base: The simulation of the config itself.
        chosen: The numbers.
        needed: Columns of the histories.
        step: By how much a number is changed, of itself.
        strict: Whether a key that can have none is a mistake.
        both: Whether there is one in which the number is smaller, too.

    Raises:
        ConfigError: If it is.
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
        self.pairs: list[Pair] = []
        for key in chosen:
            try:
                signs = (1, -1) if both else (1,)
                sides = tuple(self._side(sources, key, 1 + s * step) for s in signs)
            except ConfigError as error:
                if strict:
                    raise ConfigError(f"{key.name}: {error}") from None
                self.left_out[key.name] = str(error)
                continue
            self.pairs.append(Pair(key, sides))

    def _side(self, sources: Sources, key: Key, factor: float) -> Side:
        base = self._base
        config = changed(base.case.config, key, factor)
        program = tuple(s.model_copy(update={"stop_when": ()}) for s in config.program)
        config = config.model_copy(update={"program": program, "stop_when": ()})  # the base decides
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
        """Follow to the present state."""
        engine = self._base.engine
        problem, newton, system = engine.problem, engine.newton, engine.newton.system
        laws, q, linear, own = dict(system.ports), system.q.copy(), -1, Numbers.of(engine.problem)

        def back() -> None:
            own.put(problem)
            system.ports.update(laws)
            q.copy(system.q)
            system.residual(system.q, system.residual_vector)

        for side in (side for pair in self.pairs for side in pair.sides):
            if system.tangents != linear:  # the first one, or a quantity has needed one of its own
                back()
                newton.linearise()
                linear = system.tangents
            side.numbers.put(problem)
            side.rows.append(side.simulation.beside(self._base.progress, q).row)
            side.numbers.take(problem)
        back()
        free(self._base.comm)

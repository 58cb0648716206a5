"""Derivatives of results by the numbers of a config, from one run (direct differentiation).

Each number is slightly increased and decreased in the equations of the problem. At each converged
state, one step of Newton's method with the tangent of that state gives the states of both changed
configs. They have their own histories and internal states, so that the difference of their results
is the derivative along the whole program. Its error is of second order in the change.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from dealib.config.bias import SecondFilm
from dealib.config.case import Case
from dealib.config.schema import Config
from dealib.design.keys import in_time, keys
from dealib.design.neighbours import Neighbours
from dealib.errors import ConfigError, Place, ValueAt, by_caller, did_you_mean
from dealib.fem.reuse import Reuse
from dealib.program.simulation import Simulation
from dealib.program.work import LOST, STORED
from dealib.study.expressions import Expression
from dealib.study.rows import StageRows
from dealib.study.scope import of_history, stages, traced

if TYPE_CHECKING:
    import pandas

log = logging.getLogger(__name__)

STEP, _ROUGH = 1e-5, 1e-4  # relative change of a number: of central, of one-sided differences


@dataclass
class Sensitivities:
    """Sensitivities of a config.

    Attributes:
        values: Value of each quantity.
        rows: Rows of `sensitivity.csv`, one for each quantity and key.
        left_out: Reason for each key without a sensitivity.
    """

    values: dict[str, float]
    rows: list[dict[str, Any]]
    left_out: dict[str, str]


def sensitivities(
    case: Case,
    of: Sequence[str] = (),
    key: Sequence[str] = (),
    at: str | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> pandas.DataFrame:
    """Derivatives of quantities by numbers of a config (collective).

    Args:
        case: The case.
        of: Quantities: expressions over the history, as in studies. A column stands for its value
            at the end of the stage `at`. Default: the dual of each port's input there.
        key: Names of numbers or of sections of the config; default all that the file gives.
        at: Name of a stage; default the last one.
        comm: MPI communicator.

    Returns:
        A row for each quantity and number, with the columns of `sensitivity.csv`: `quantity`,
        `key`, `value`, `unit`, `derivative` and `logarithmic`, which is d ln / d ln.

    Raises:
        ConfigError: If a quantity, key or stage is unknown, or the program has no sensitivities
            (see `refuse`).
        NotConverged: If a step failed.
    """
    import pandas as pd

    return pd.DataFrame(find(case, of, key, at, comm).rows)


def find(
    case: Case,
    of: Sequence[str] = (),
    key: Sequence[str] | None = (),
    at: str | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    rough: bool = False,
    reuse: Reuse | None = None,
) -> Sensitivities:
    """Values and sensitivities of quantities (collective); see `sensitivities`.

    Args:
        case: The case.
        of: Quantities.
        key: Numbers or sections; None: values alone, which any program has.
        at: Name of a stage.
        comm: MPI communicator.
        rough: Take one-sided differences, which are accurate to 1e-4 and need half the time, and
            leave out named keys without a sensitivity instead of raising an error.
        reuse: Provides the solver of an earlier case.
    """
    if key is not None:
        with case.blamed():
            refuse(case.config)
    case = replace(case, config=as_function_of_state(case.config))
    quantities = _Quantities(case.config, of, at)
    chosen = [] if key is None else keys(case.config, key)
    if chosen and not quantities.ends_only:  # the states beside need one in each row
        program = tuple(stage.all_solved for stage in case.config.program)
        case = replace(case, config=case.config.model_copy(update={"program": program}))
    base = Simulation(case, comm, reuse=reuse)
    step, strict = (_ROUGH, False) if rough else (STEP, bool(key))
    near = Neighbours(base, chosen, quantities.needed, step, strict, both=not rough)
    rows, given = [], set[str]()
    for state in base:
        rows.append(state.row)
        if near.pairs and (state.end_of_stage or not quantities.ends_only):
            near.follow()
        if state.row["stage"] == quantities.stage:
            laws = base.engine.newton.system.ports
            given = {name for name, law in laws.items() if law.value is not None}
    values = quantities.values(rows, given)
    found = []
    for name, value in values.items():
        for beside in near.pairs:
            sides = [quantities.value(name, s.rows, s.config) for s in beside.sides]
            k, other = beside.key, value if rough else sides[1]
            slope = (sides[0] - other) / (len(sides) * step * k.value)
            logarithmic = slope * k.value / value if value else float("nan")
            numbers = {"derivative": float(slope), "logarithmic": float(logarithmic)}
            found.append({"quantity": name, "key": k.name, "value": k.value, "unit": k.unit})
            found[-1] |= numbers
    return Sensitivities(values, found, near.left_out)


def as_function_of_state(config: Config) -> Config:
    """The config without columns of the history that are no function of the state alone."""
    kept = {"output": {"modes": 0}, "sensing": {"differential": False}}
    changes = {k: getattr(config, k).model_copy(update=v) for k, v in kept.items()}
    return config.model_copy(update=changes)


def refuse(config: Config) -> None:
    """Raise `ValueAt` for a program without sensitivities: they need equilibria at given loads."""
    known = "sensitivities need a program in equilibrium"
    for i, stage in enumerate(config.program):
        where: Place = ("program", i)
        if stage.follow is not None:
            said = "sensitivities need given loads, which states on a branch do not have"
            raise ValueAt((*where, "follow"), said)
        if stage.dynamic:
            raise ValueAt((*where, "dynamic"), known)
        for path, _, _, given in stage.inputs:
            for k, element in enumerate(getattr(given, "bias", None) or ()):
                if isinstance(element.given[1], SecondFilm):
                    said = "there are no sensitivities with a second film, which is solved alone"
                    raise ValueAt((*where, *path, "bias", k, "film"), said)
    if config.sensing.charging:
        raise ValueAt(("sensing", "charging"), known)
    for name, material in config.materials.items():
        for softens in ("mullins", "permanent_set"):
            if getattr(material, softens) is not None:
                said = "there are no sensitivities with a softening law, whose stress has a kink "
                said += "at the largest energy so far"
                raise ValueAt(("materials", name, softens), said)


class _Quantities:
    """The quantities whose sensitivities are computed.

    Attributes:
        stage: Stage at whose end columns are taken.
        needed: Columns that the quantities read.

    Args:
        config: The config.
        of: Expressions; none: the dual of each port's input.
        at: Stage at whose end columns are taken; None: the last one.

    Raises:
        ConfigError: If an expression or the stage is wrong.
    """

    def __init__(self, config: Config, of: Sequence[str], at: str | None) -> None:
        self._config, known = config, stages(config)
        self.stage = known[-1] if at is None else at
        if self.stage not in known:
            raise ConfigError(
                f"{by_caller('--at', 'at')}: there is no stage {at!r}{did_you_mean(at, known)}"
            )
        if known.count(self.stage) > 1:
            raise ConfigError(f"{by_caller('--at', 'at')}: several stages are named {self.stage!r}")
        ports = [port for port in config.device.ports if not port.floating]
        self._answers = {
            port.name: tuple(port.column(v) for v in port.kind.variables) for port in ports
        }
        texts = of or [column for pair in self._answers.values() for column in pair]
        self._asked = bool(of)
        self._known = {text: self._parsed(text) for text in texts}
        self.needed = {name for e in self._known.values() for name in e.names}
        if any(name == "stroke" for e in self._known.values() for name, _ in e.calls):
            self.needed |= {column for pair in self._answers.values() for column in pair}
        if "energy_residual_mJ" in self.needed:
            self.needed |= {*STORED, *LOST}

    @property
    def ends_only(self) -> bool:
        """Whether only states at the ends of stages are needed, independent of those before."""
        history = in_time(self._config) or any(map(traced, self.needed))
        return not history and all(e.ends_only for e in self._known.values())

    def _parsed(self, text: str) -> Expression:
        try:
            return of_history(text, self._config)
        except ValueError as error:
            raise ConfigError(f"{by_caller('--of', 'of')}: {error}") from None

    def value(self, name: str, rows: Sequence[dict[str, Any]], config: Config) -> float:
        """Value of a quantity in a history.

        Raises:
            ConfigError: If the value is not a number.
        """
        columns = {k: np.array([r[k] for r in rows]) for k in rows[0] if k != "stage"}
        history = StageRows(columns, [row["stage"] for row in rows], config)
        try:
            found = np.asarray(self._known[name](history.names, history.functions), float)
            if found.ndim:
                found = found[history.of(self.stage)[-1]]
            return self._known[name].finite(float(found))
        except (ValueError, IndexError) as error:
            raise ConfigError(f"{by_caller('--of', 'of')}: {error}") from None

    def values(self, rows: Sequence[dict[str, Any]], given: set[str]) -> dict[str, float]:
        """Values in the history of the unchanged config.

        Args:
            rows: The history.
            given: Names of ports whose primal variable, such as the voltage, is prescribed; by
                default the dual one is reported for them.
        """
        chosen = list(self._known)
        if not self._asked:
            chosen = [pair[int(name in given)] for name, pair in self._answers.items()]
        return {name: self.value(name, rows, self._config) for name in chosen}

"""Progress of a load program: the plain values that make a checkpoint with the fields."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

from dealib.program.increments import StageClock
from dealib.program.inputs import Drive, Drives
from dealib.program.knots import Knots
from dealib.program.pair import Two
from dealib.program.work import Work


@dataclass
class Position:
    """Position on a followed branch.

    Attributes:
        sizes: Sizes of both variables; that of the second is its distance to the end.
        length: Arc length so far, over those sizes.
        step: Arc length of the next step.
        point: Both variables.
        direction: Direction of the branch, over the sizes.
        rising: Sign of the varied variable's change from here on.
        modes: Number of unstable modes from here on; None if not known.
        count: Number of states.
        done: Whether the end is reached.
    """

    sizes: Two
    length: float = 0.0
    step: float = 0.0
    point: Two = (0.0, 0.0)
    direction: Two = (0.0, 0.0)
    rising: float = 0.0
    modes: int | None = None
    count: int = 0
    done: bool = False

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Position:
        """From plain values, also after a round trip through JSON."""
        given: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in plain.items()
        }
        return cls(**given)


@dataclass
class ProgramState:
    """Everything that the rest of a program depends on, except for the fields.

    Attributes:
        step: Number of the last converged step, -1 before the first.
        time: Its clock time, s.
        stage: Index of its stage; 0 is pre-strain.
        stage_start: Clock time at which the stage began, s.
        clock: Time and increment in the stage, in cycles.
        branch: Position in a stage that follows a branch.
        drives: The drives of each port.
        work: Work done so far.
        row: The last row of the history, none before the first.
        ports: Value and dual of each port in the last state.
        through: Volume that has flowed into chambers through each opening, mm^3.
        worst: Largest use of each limit so far (see `margins.keep`).
        over: Whether a condition has ended the stage.
        knots: Solved states between which rows are interpolated, with `steps: auto`.
        stops: Stages that a condition ended: `step`, `time_s`, `stage`, `when`, and `ends`, which
            is 'stage' or 'run'.
    """

    step: int = -1
    time: float = 0.0
    stage: int = 0
    stage_start: float = 0.0
    clock: StageClock = field(default_factory=StageClock)
    branch: Position | None = None
    drives: dict[str, Drives] = field(default_factory=dict)
    work: Work = field(default_factory=Work)
    row: dict[str, Any] | None = None
    ports: dict[str, Two] = field(default_factory=dict)
    through: dict[str, float] = field(default_factory=dict)
    worst: dict[str, dict[str, Any]] = field(default_factory=dict)
    over: bool = False
    knots: Knots = field(default_factory=Knots)
    stops: list[dict[str, Any]] = field(default_factory=list)

    @property
    def ended(self) -> bool:
        """Whether a condition has ended the run."""
        return bool(self.stops) and self.stops[-1]["ends"] == "run"

    def plain(self) -> dict[str, Any]:
        """As numbers, texts, lists and dicts."""
        drives = {port: [d.plain() for d in found] for port, found in self.drives.items()}
        return asdict(replace(self, drives={})) | {"drives": drives}

    @classmethod
    def of(cls, plain: dict[str, Any]) -> ProgramState:
        """Inverse of `plain`, also after a round trip through JSON."""
        given = dict(plain)
        given["clock"], given["work"] = StageClock(**given["clock"]), Work(**given["work"])
        given["knots"] = Knots(**given.get("knots", {}))  # checkpoints of before have none
        given["branch"] = given["branch"] and Position.of(given["branch"])
        given["ports"] = {name: tuple(pair) for name, pair in given["ports"].items()}
        given["drives"] = {
            port: tuple(map(Drive.of, drives)) for port, drives in given["drives"].items()
        }
        return cls(**given)

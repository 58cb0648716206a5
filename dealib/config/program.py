"""The stages of the load program in the config."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import (
    Field,
    PlainSerializer,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from dealib.config.follow import Follow
from dealib.config.inputs import ChamberInput, Input, MountInput, TerminalInput, TurnInput
from dealib.config.names import Cell
from dealib.config.stop import Condition
from dealib.config.wave import Wave
from dealib.device.device import Device
from dealib.device.records import KINDS, RIGID, PortKind, not_held
from dealib.errors import Place, ValueAt, did_you_mean
from dealib.section import Section
from dealib.units import Time

_KEPT = "input of the stage; keeps its last value if not given"
_ROWS = 40  # of a cycle with `steps: auto`
_LOADS = ("force", "mass")  # inputs that hold nothing


def _steps(given: object, number: ValidatorFunctionWrapHandler) -> int | str:
    if isinstance(given, str) and not given.strip().isdigit():
        if given != "auto":
            raise ValueError(f"expected a number of steps, or auto, not {given!r}")
        return given
    return int(number(given))


if TYPE_CHECKING:
    Steps: TypeAlias = int | Literal["auto"]
else:
    Steps = Annotated[
        int,
        Field(ge=1),
        WrapValidator(_steps, json_schema_input_type=Annotated[int, Field(ge=1)] | Literal["auto"]),
        PlainSerializer(lambda given: given, return_type=int | str),
    ]


class Stage(Section):
    """One stage: the inputs of the ports, its duration and its steps."""

    stage: Cell = Field(
        min_length=1, description="name; `prestrain` ramps the materials' pre-stretch from 1"
    )
    duration: Time = Field(1.0, gt=0, description="duration of one cycle")
    steps: Steps = Field(
        1,
        description="equal increments per cycle, halved where Newton's method fails; or `auto`: "
        "states are solved where the curves need them, and the rows between are interpolated to "
        "1e-5 of the range of each column (column `solved`); for equilibria only",
    )
    rows: int | None = Field(
        None,
        ge=1,
        description=f"with `steps: auto`: rows of the history per cycle; default {_ROWS}",
    )
    cycles: int = Field(1, ge=1, description="number of cycles")
    mount: MountInput | None = Field(None, description=_KEPT)
    terminal: TerminalInput | None = Field(None, description=_KEPT)
    chamber: ChamberInput | None = Field(None, description=_KEPT)
    turn: TurnInput | None = Field(None, description=_KEPT)
    mounts: dict[str, MountInput] | None = Field(
        None, description="inputs by name, if there are several mounts"
    )
    terminals: dict[str, TerminalInput] | None = Field(
        None, description="inputs by name, if there are several terminals"
    )
    chambers: dict[str, ChamberInput] | None = Field(
        None, description="inputs by name, if there are several chambers"
    )
    turns: dict[str, TurnInput] | None = Field(
        None, description="inputs by name, such as PLATE.about_Z, if there are several"
    )
    stop_when: tuple[Condition, ...] = Field((), description="conditions that end the stage")

    dynamic: bool = Field(
        False, description="integrate the equations of motion; the steps are time steps"
    )
    follow: Follow | None = Field(
        None, description="follow the branch of equilibria past limit points, without inputs"
    )

    @property
    def auto(self) -> bool:
        """Whether states are solved only where the curves need them."""
        return self.steps == "auto"

    @property
    def count(self) -> int:
        """Rows of the history per cycle: its steps, unless these are chosen."""
        return (self.rows or _ROWS) if self.steps == "auto" else self.steps

    @property
    def all_solved(self) -> Stage:
        """The same stage with a solved state in each row."""
        return self.model_copy(update={"steps": self.count, "rows": None})

    @property
    def inputs(self) -> list[tuple[Place, PortKind, str | None, Input]]:
        """Path, kind, name and input of each driven port; the only port of a kind has name None."""
        found: list[tuple[Place, PortKind, str | None, Input]] = []
        for kind in KINDS.values():
            alone = getattr(self, kind.name)
            found += [((kind.name,), kind, None, alone)] if alone is not None else []
            many = f"{kind.name}s"
            found += [
                ((many, n), kind, n, given) for n, given in (getattr(self, many) or {}).items()
            ]
        return found

    def driven(self, device: Device) -> dict[str, Input]:
        """Inputs of the driven ports, by the name of the port."""
        return {name or _connected(device, kind)[0]: given for _, kind, name, given in self.inputs}

    @model_validator(mode="after")
    def _chosen(self) -> Stage:
        if self.rows is not None and not self.auto:
            raise ValueAt(("rows",), "only with steps: auto; else each step is a row")
        if not self.auto:
            return self
        why = ""
        if self.stage == "prestrain":
            why = "a prestrain stage is one row"
        elif self.follow is not None:
            why = "a stage with follow chooses its steps along the branch; these are its largest"
        elif self.dynamic:
            why = "steps in time have their own control, solver.time_tolerance"
        if why:
            raise ValueAt(("steps",), f"auto is for stages in equilibrium: {why}; give a number")
        return self

    @model_validator(mode="after")
    def _follows_alone(self) -> Stage:
        if self.follow is None:
            return self
        for path, *_ in self.inputs:
            raise ValueAt(
                path, "a stage that follows a branch takes no input; use a stage before it"
            )
        if self.cycles > 1:
            raise ValueAt(("cycles",), "a stage that follows a branch has one cycle")
        if self.dynamic:
            raise ValueAt(
                ("dynamic",), "a stage that follows a branch of equilibria cannot be dynamic"
            )
        if self.stage == "prestrain":
            raise ValueAt(("follow",), "a prestrain stage takes no input")
        return self

    @model_validator(mode="after")
    def _cycles_close(self) -> Stage:
        """Refuse cycles whose input would jump from the end of one to the start of the next."""
        if self.cycles == 1:
            return self
        driven = [(path, *found) for path, _, _, given in self.inputs for found in given.courses]
        if not driven:
            raise ValueAt(("cycles",), "cycles repeat an input of the stage; this one has none")
        for path, name, values in driven:
            where: Place = (*path, *name)
            if isinstance(values, Wave):
                where, need = ("cycles",), "lists; for more periods of a wave, increase duration"
            elif len(values) == 1:
                need = "a list, such as [0, peak, 0] with units"
            elif values[0] != values[-1]:
                need = "a list that ends where it begins"
            else:
                continue
            raise ValueAt(where, f"{self.cycles} cycles need {need}")
        return self


def _connected(device: Device, kind: PortKind) -> list[str]:
    """Names of the ports of a kind without floating conductors."""
    return [port.name for port in device.of(kind) if not port.floating]


def check_inputs(program: Sequence[Stage], device: Device) -> None:
    """Raise `ValueAt` if a stage drives a port that the device lacks, or one port twice."""
    for i, stage in enumerate(program):
        seen: set[str] = set()
        for path, kind, name, given in stage.inputs:
            known, where = _connected(device, kind), ("program", i, *path)
            if not known:
                raise ValueAt(where, device.lacks(kind))
            if name is None and len(known) > 1:
                several = f"there are several: {', '.join(known)}"
                raise ValueAt(where, f"{several}; name them under `{kind.name}s`")
            if name in device.by_name and device.by_name[name].floating:
                problem = f"{name!r} floats: nothing is connected to it"
                raise ValueAt(where, f"{problem}; add it to `terminals` to drive it")
            if name is not None and name not in known:
                raise ValueAt(where, f"there is no {kind.name} {name!r}{did_you_mean(name, known)}")
            if getattr(given, "liquid", None) and not device.by_name[name or known[0]].openings:
                problem = "the chamber has no openings; prescribe its volume instead"
                raise ValueAt((*where, "liquid"), problem)
            if (name or known[0]) in seen:
                raise ValueAt(where, f"the {kind.name} {name or known[0]!r} is driven twice")
            seen.add(name or known[0])


def check_steps(config: Any) -> None:
    """Raise `ValueAt` if steps are to be chosen where states depend on the steps before them."""
    auto = [i for i, stage in enumerate(config.program) if stage.auto]
    why = [
        f"materials.{name}.{law.memory[0]} gives states a memory"
        for name, law in config.solids.items()
        if law.memory
    ]
    if config.sensing.charging:
        why.append("with sensing.charging states depend on time")
    if any(port.openings for port in config.device.ports):
        why.append("what flows through openings depends on time")
    if auto and why:
        told = f"auto is for stages in equilibrium: {why[0]}; give a number"
        raise ValueAt(("program", auto[0], "steps"), told)


def check_held(program: Sequence[Stage], device: Device) -> None:
    """Raise `ValueAt` if in some stage nothing holds the device along an axis.

    Whether it may turn depends on where its supports are, which its mesh tells (`fem.rigid`).
    """
    loaded = set[str]()
    _check_axes(device, loaded)
    for stage in program:
        for name, given in stage.driven(device).items():
            (loaded.add if given.given[0] in _LOADS else loaded.discard)(name)
        if stage.follow is not None:  # it drives both of its ports in its own way
            loaded.clear()
        if not stage.dynamic:
            _check_axes(device, loaded)


def _check_axes(device: Device, loaded: set[str]) -> None:
    axes = device.kinematics.axes
    for axis in axes[1:] if device.kinematics.revolved else axes:
        ports = (
            f"{s.port}.{axis}" if s.kind == RIGID else s.port
            for s in device.supports
            if s.quantity == axis
        )
        if loaded.issuperset(ports):
            raise ValueAt(("holds",), not_held(f"along {axis}"))

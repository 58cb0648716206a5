"""Chambers with openings: flow and content, integrated in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from dealib.config.chamber import Filled
from dealib.device.device import Device
from dealib.device.records import CHAMBER
from dealib.fem.port_law import PortLaw
from dealib.program.inputs import Drives


class Flows:
    """Steps in time of all chambers with openings.

    Attributes:
        drives: The drives of the ports; changed in place.
        through: Volume that has flowed in through each opening, mm^3; changed in place.

    Args:
        device: The device.
        drives: See above.
        through: See above.
        laws: The ports' equations; changed in place.
        values: Gives the values of the ports at the last residual.
        least: Smallest volume with which errors are compared, mm^3.
    """

    def __init__(
        self,
        device: Device,
        drives: dict[str, Drives],
        through: dict[str, float],
        laws: dict[str, PortLaw],
        values: Callable[[], dict[str, float]],
        least: float,
    ) -> None:
        self.drives, self.through, self._laws, self._values = drives, through, laws, values
        self._chambers = [port.name for port in device.of(CHAMBER) if port.openings]
        self._least = least

    @property
    def filled(self) -> dict[str, Filled]:
        """The chambers that are filled with gas or liquid in the current stage."""
        found = {name: self.drives[name][0].element for name in self._chambers}
        return {name: f for name, f in found.items() if isinstance(f, Filled)}

    def _put(self, name: str, filled: Filled) -> None:
        first, *others = self.drives[name]
        self.drives[name] = (replace(first, element=filled), *others)

    def begin(self, duration: float) -> None:
        """Prepare a step of a duration in s."""
        for name, filled in self.filled.items():
            self._put(name, filled.model_copy(update={"step": duration}))

    def error(self) -> float:
        """Error of the step's inflow over the volume inside, or the least one."""
        missed, inside = 0.0, self._least
        for name, filled in self.filled.items():
            x = self._values()[name]
            ends = zip(
                filled.flows(x).values(), filled.flows(filled.pressure).values(), strict=True
            )
            missed += sum(abs(now[0] - before[0]) for now, before in ends) * filled.step / 2
            inside = max(inside, abs(filled.amount) if filled.gas is None else filled.gas.volume)
        return missed / inside

    def commit(self) -> None:
        """Accept the step; the ports' equations then have the new content and no flow.

        Small changes of the state are asked of these equations.
        """
        for name, filled in self.filled.items():
            x = self._values()[name]
            for opening, (flow, _) in filled.flows(x).items():
                self.through[opening] = self.through.get(opening, 0.0) + filled.step * flow
            after, known = filled.after(x), self._laws[name]
            self._put(name, after)
            (_, anchor), *others = known.elements
            self._laws[name] = replace(known, elements=((after, anchor), *others))

    @contextmanager
    def tentative(self) -> Iterator[None]:
        """Accept the step for a while, to look at it."""
        drives, through, laws = dict(self.drives), dict(self.through), dict(self._laws)
        self.commit()
        try:
            yield
        finally:
            self.drives.update(drives)
            self._laws.update(laws)
            self.through.clear()
            self.through.update(through)

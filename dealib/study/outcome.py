"""A solved case for expressions: its history, config, timings and fields."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.errors import did_you_mean
from dealib.materials.response import response
from dealib.results import spectra
from dealib.results.reader import Run
from dealib.results.sampling import LayerStrip
from dealib.results.section import RunSection
from dealib.study import sample
from dealib.study.expressions import Expression, Function
from dealib.study.plan import Planned
from dealib.study.rows import StageRows
from dealib.study.schema import MaterialTest

if TYPE_CHECKING:
    import pandas


class Outcome:
    """A case with its results.

    Args:
        case: The case.
        run: Its run; None for a material test.
    """

    def __init__(self, case: Planned, run: Run | None) -> None:
        self.case, self.run = case, run
        self._arrays: dict[str, dict[str, Array]] = {}
        self._strips: dict[str, LayerStrip] = {}

    @cached_property
    def history(self) -> pandas.DataFrame:
        """The history of the run or of the material test, or the table that the case names."""
        if self.run is not None and self.case.table:
            return spectra.read(self.run.directory / self.case.table)
        if self.run is not None:
            return self.run.history
        import pandas as pd

        test = self.case.work
        assert isinstance(test, MaterialTest)
        stretch = np.linspace(*test.stretch, test.points)
        stress = response(test.material, test.mode, stretch)[0]
        columns = {"stretch": stretch, "strain": stretch - 1, "stress_MPa": stress}
        return pd.DataFrame({"stage": test.mode, **columns})

    @property
    def ended_by(self) -> str:
        """The conditions that ended the run or its stages early, with their times; or ''."""
        stops = () if self.run is None else self.run.info.get("stops", ())
        return "; ".join(f"{s['when']} at {s['time_s']:.4g} s in {s['stage']}" for s in stops)

    def evaluate(self, expression: Expression) -> Any:
        """Value of an expression in the scope of this case.

        Raises:
            ValueError: If the case has no such name, stage or field.
        """
        return expression(self._rows.names, self._functions)

    @cached_property
    def _rows(self) -> StageRows:
        h = self.history
        names = {str(c): h[c].to_numpy(float) for c in h.columns if c != "stage"}
        stages = h["stage"].to_numpy() if "stage" in h else np.full(len(h), "")
        return StageRows(names, stages, self.case.work)

    @cached_property
    def _functions(self) -> Mapping[str, Function]:
        return self._rows.functions | {
            "timing": self._timing,
            "field": lambda name, region, s, t, stage: sample.at(
                self.strip(region),
                self.arrays(stage),
                name,
                sample.fraction("along", s),
                sample.fraction("across", t),
            ),
            "across": lambda name, region, s, stage: sample.across(
                self.strip(region), self.arrays(stage), name, sample.fraction("along", s)
            ),
            "along": lambda name, region, t, stage: sample.along(
                self.strip(region), self.arrays(stage), name, sample.fraction("across", t)
            ),
        }

    def _timing(self, name: str) -> float:
        timings = {} if self.run is None else self.run.info.get("timings", {})
        if name not in timings:
            raise ValueError(f"no timing {name!r}{did_you_mean(name, timings)}")
        return float(timings[name])

    def step(self, stage: str) -> int:
        """The stored step at the end of a stage.

        Raises:
            ValueError: If its fields are not stored.
        """
        if self.run is None:
            raise ValueError("a material test has no fields")
        step = int(self.history["step"].iloc[self._rows.of(stage)[-1]])
        if step not in self.run.stored_steps:
            raise ValueError(f"the fields at the end of stage {stage!r} are not stored")
        return step

    def arrays(self, stage: str) -> dict[str, Array]:
        """All nodal fields at the end of a stage.

        Raises:
            ValueError: If they are not stored.
        """
        if stage not in self._arrays:
            step = self.step(stage)
            assert self.run is not None
            self._arrays[stage] = self._section.arrays(self.run.stored_steps.index(step))
        return self._arrays[stage]

    def nearest(self, time: float) -> int:
        """The stored step nearest to a time.

        Raises:
            ValueError: If no fields are stored.
        """
        steps = [] if self.run is None else self.run.stored_steps
        if not steps:
            raise ValueError("no fields are stored")
        stored = self.history[self.history["step"].isin(steps)]
        return int(stored["step"].iloc[int((stored["time_s"] - time).abs().to_numpy().argmin())])

    def strip(self, region: str) -> LayerStrip:
        """The strip of cells of a region.

        Raises:
            ValueError: If there is no such region.
        """
        if self.run is None:
            raise ValueError("a material test has no regions")
        if region not in self._strips:
            self._strips[region] = self._section.layer(region)
        return self._strips[region]

    @cached_property
    def _section(self) -> RunSection:
        assert self.run is not None
        return RunSection(self.run)

    @property
    def config(self) -> Config:
        """The config of the run."""
        assert isinstance(self.case.work, Config)
        return self.case.work

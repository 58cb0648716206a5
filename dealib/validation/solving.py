"""Solution of a benchmark's case by a worker: a run, with vibrations or a spectrum."""

from __future__ import annotations

from dataclasses import replace

from dealib.cases import job as jobs
from dealib.cases.job import Job, Report
from dealib.config import load
from dealib.config.messages import validate
from dealib.config.source import Source
from dealib.validation.schema import Benchmark

DEVICE = "device"  # key of the config in the file of a benchmark


def solve(job: Job, report: Report | None) -> None:
    """Solve a case; its base is the file of the benchmark."""
    given = validate(Benchmark, Source(job.base))
    case = load(job.base, job.overrides, within=DEVICE)
    if given.spectrum is not None:
        job = replace(job, spectrum=(given.spectrum, given.spectrum.stage))
    if given.modes is None:
        jobs.solve(case, job, report)
        return
    from dealib.program.modes import ModesWatch, at_rest
    from dealib.results import spectra

    stages = [given.modes.stage] if given.modes.stage else []
    watch = ModesWatch(stages, None, given.modes.count)
    jobs.solve(at_rest(case, stages), job, report, look=watch)
    watch.check()
    spectra.write(job.directory / spectra.MODES, watch.rows)

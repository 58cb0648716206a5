"""Benchmarks: what a command costs, from its start to the prompt.

    python tests/benchmarks/run.py                    # all but --large; about 5 minutes
    python tests/benchmarks/run.py --only deap100     # one group
    python tests/benchmarks/run.py --large            # with 1e6 unknowns
    python tests/benchmarks/run.py --readme           # only renew README.md's table

Every run is a process of its own, so that import, mesh, memory and processor time are its own too.
`plain` are the settings of the prototype, as options of the same program: from the last state and
with LU of the whole tangent. Variants of a group alternate, so that a busy machine is
as unkind to all of them; medians and minima are over the repetitions.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RESULTS = Path(__file__).with_name("results.json")
PLAIN = ("solver.predictor_order=0", "solver.linear=lu")
PHASES = (
    "import",
    "mesh",
    "forms",
    "matrix",
    "assembly",
    "factorisation",
    "output",
    "solve",
    "writing",
)
_REPEATED = ("quick", "strip", "strip_air", "deap100", "ranks")
MARKS = ("<!-- benchmarks:begin -->", "<!-- benchmarks:end -->")


@dataclass(frozen=True)
class Command:
    """One `dealib run`, or another command.

    Attributes:
        group: Runs that are compared with each other.
        variant: Which of them this is.
        config: Shipped config.
        changes: Its changes, as for `--set`.
        ranks: MPI ranks.
        cold: Compile the forms anew.
        jobs: A sweep of 8 cases on so many processes instead.
    """

    group: str
    variant: str
    config: str = "benchmark_strip"
    changes: tuple[str, ...] = ()
    ranks: int = 1
    cold: bool = False
    jobs: int = 0

    def line(self, folder: Path) -> list[str]:
        """The command line; results go into a folder."""
        program = [sys.executable, "-m", "dealib"]
        if self.jobs:
            study = folder / "sweep.yaml"
            study.write_text(_STUDY.format(base=ROOT / f"configs/{self.config}.yaml"))
            where = ["--out", str(folder / "sweep"), "--cache", str(folder / "cases")]
            return [*program, "sweep", str(study), "-j", str(self.jobs), *where]
        line = [*program, "run", str(ROOT / f"configs/{self.config}.yaml")]
        line += ["--out", str(folder / "run"), "--overwrite", "--mpi", str(self.ranks)]
        return line + [f"--set={change}" for change in self.changes]


_STUDY = """\
name: sweep
title: throughput
base: {base}
vary:
  thickness: {{geometry.film_thickness: [30 um, 31 um, 32 um, 33 um, 34 um, 35 um, 36 um, 37 um]}}
quantities: {{force: 'end(force_N, "push")'}}
"""
_TWO_STEPS = (
    "program=[{stage: prestrain}, {stage: push, mount: {displacement: -0.5 mm}, steps: 2}]",
    "output.fields=stage",
)


def finer(factor: int, air: bool = False) -> tuple[str, ...]:
    """Changes that divide the cells of the strips, and of the air, in each direction."""
    rows = (f"mesh.columns={60 * factor}", f"mesh.film_rows={4 * factor}")
    rows += (f"mesh.electrode_rows={factor}", *_TWO_STEPS)
    return (*rows, f"mesh.air_size={1.2 / factor} mm") if air else rows


def commands(large: bool) -> Iterator[Command]:
    """All benchmarks."""
    names = {"strip": "benchmark_strip", "strip_air": "benchmark_strip_air", "deap100": "deap100"}
    for group, config in names.items():
        yield Command(group, "dealib", config)
        yield Command(group, "plain", config, PLAIN)
    yield Command("start", "warm", "deap100")
    yield Command("start", "cold", "deap100", cold=True)
    for factor in (1, 2, 4, 8):
        yield Command("refinement", f"{factor**2}x", changes=finer(factor))
    for factor in (1, 2, 4):
        air = finer(factor, air=True)
        yield Command("refinement in air", f"{factor**2}x", "benchmark_strip_air", air)
    for ranks in (1, 2):
        yield Command("ranks", f"{ranks} ranks", changes=finer(7), ranks=ranks)
    for jobs in (1, 2):
        yield Command("sweep of 8", f"-j {jobs}", jobs=jobs)
    if large:
        yield Command("large", "256x", changes=finer(16))
        yield Command("large", "256x, 2 ranks", changes=finer(16), ranks=2)
        yield Command("large", "64x in air", "benchmark_strip_air", finer(8, air=True))


QUICK = tuple(
    Command("quick", name, changes=("mesh.columns=8", "mesh.film_rows=1", *_TWO_STEPS, *plain))
    for name, plain in (("dealib", ()), ("plain", PLAIN))
)


def measure(command: Command) -> dict[str, Any]:
    """Run a command once.

    Returns:
        Wall and processor time (s, of all its processes), peak memory (MB, of its largest process)
        and, of a run, its unknowns, iterations and seconds by phase.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
        environment["PYTHONPATH"] = str(ROOT)
        if command.cold:
            environment["XDG_CACHE_HOME"] = str(folder / "cache")
        begin = time.perf_counter()
        with (folder / "output").open("w") as output:
            process = subprocess.Popen(
                command.line(folder), env=environment, stdout=output, stderr=output, cwd=folder
            )
            _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
        if status:
            raise SystemExit(f"{command}:\n{(folder / 'output').read_text()}")
        found = {
            "wall": wall,
            "cpu": usage.ru_utime + usage.ru_stime,
            "memory_MB": usage.ru_maxrss / 1024,
        }
        if command.jobs:
            return found | {"cases_per_minute": 8 * 60 / wall}
        info = json.loads((folder / "run/run.json").read_text())
        size = sum(f.stat().st_size for f in (folder / "run").rglob("*") if f.is_file())
        found |= {
            "unknowns": info["unknowns"],
            "steps": info["steps"],
            "iterations": info["newton_iterations"],
            "files_MB": size / 1e6,
        }
        return found | {phase: info["timings"].get(phase, 0.0) for phase in PHASES}


def repeat(todo: list[Command], times: int) -> list[dict[str, Any]]:
    """Medians and minima; the variants of a group take turns."""
    records = []
    for group in dict.fromkeys(c.group for c in todo):
        members = [c for c in todo if c.group == group]
        runs: dict[str, list[dict[str, Any]]] = {c.variant: [] for c in members}
        for _ in range(times if group in _REPEATED else 1):
            for command in members:
                runs[command.variant].append(measure(command))
                print(f"{group} {command.variant}: {runs[command.variant][-1]['wall']:.2f} s")
        for command in members:
            of = runs[command.variant]
            record: dict[str, Any] = {"group": group, "variant": command.variant, "runs": len(of)}
            record |= {k: statistics.median(run[k] for run in of) for k in of[0]}
            record["least"] = {k: min(run[k] for run in of) for k in ("wall", "cpu")}
            if "solve" in record:
                record["least"]["solve"] = min(run["solve"] for run in of)
                share = [1 - (r["assembly"] + r["factorisation"]) / r["solve"] for r in of]
                record["overhead"] = statistics.median(share)
            records.append(record)
    return records


def machine() -> dict[str, Any]:
    """Processor model and number of cores."""
    model = platform.processor()
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        model = re.findall(r"model name\s*:\s*(.*)", text)[0]
    except (OSError, IndexError):
        pass
    return {"processor": model, "cores": os.cpu_count()}


def table(results: dict[str, Any]) -> str:
    """The results in Markdown."""
    head = (
        *("", "wall, s", "CPU, s", "import + mesh + forms", "assembly", "factorisation"),
        *("output", "solve", "overhead", "iterations / steps", "unknowns", "memory, MB"),
    )
    lines = [" | ".join(head), "|".join(["---", *["--:"] * (len(head) - 1)])]
    for r in results["records"]:
        cells = [f"{r['group']}, {r['variant']}", f"{r['wall']:.2f}", f"{r['cpu']:.2f}"]
        if "solve" in r:
            before = r["import"] + r["mesh"] + r["forms"] + r["matrix"]
            phases = (r["assembly"], r["factorisation"], r["output"], r["solve"])
            cells += [f"{before:.2f}", *(f"{seconds:.2f}" for seconds in phases)]
            cells += [f"{100 * r['overhead']:.0f} %", f"{r['iterations']:.0f} / {r['steps']:.0f}"]
            cells += [f"{r['unknowns']:.0f}"]
        else:
            cells += [f"{r['cases_per_minute']:.0f} cases a minute", *[""] * 7]
        lines.append(" | ".join([*cells, f"{r['memory_MB']:.0f}"]))
    where = results["machine"]
    note = f"{where['processor']}, {where['cores']} cores; medians of {results['repetitions']}"
    return "\n".join([f"{note}.", "", *(f"| {line} |" for line in lines)])


def renew(readme: Path, results: dict[str, Any]) -> None:
    """Replace the table between README's marks."""
    text = readme.read_text(encoding="utf-8")
    before, rest = text.split(MARKS[0])
    _, after = rest.split(MARKS[1])
    new = f"{before}{MARKS[0]}\n{table(results)}\n{MARKS[1]}{after}"
    readme.write_text(new, encoding="utf-8")


def main(arguments: list[str] | None = None) -> None:
    """Measure, print the table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--only", nargs="+", metavar="GROUP", help="these groups only")
    parser.add_argument("--repeat", type=int, default=5, help="repetitions of what varies")
    parser.add_argument("--quick", action="store_true", help="a tiny device, to see that it works")
    parser.add_argument("--large", action="store_true", help="also the largest meshes")
    parser.add_argument("--out", type=Path, help="JSON; default results.json, if all are measured")
    parser.add_argument("--readme", action="store_true", help="only renew README.md beside it")
    given = parser.parse_args(arguments)
    if given.readme:
        renew(
            ROOT / "tests" / "benchmarks" / "README.md",
            json.loads((given.out or RESULTS).read_text(encoding="utf-8")),
        )
        return
    # the results of some groups alone would make the table lose the others
    out = given.out or (None if given.quick or given.only else RESULTS)
    todo = list(QUICK if given.quick else commands(given.large or bool(given.only)))
    if given.only:
        unknown = set(given.only) - {c.group for c in todo}
        if unknown:
            raise SystemExit(f"no group {', '.join(sorted(unknown))}")
        todo = [c for c in todo if c.group in given.only]
    results = {
        "machine": machine(),
        "repetitions": given.repeat,
        "records": repeat(todo, given.repeat),
    }
    if out is not None:
        out.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(table(results))


if __name__ == "__main__":
    main()

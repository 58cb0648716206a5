"""Measured data, comparisons, fits, materials, and the capacitance as a sensor."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from dealib.config.messages import problem
from dealib.config.source import Source
from dealib.data.schema import Selection
from dealib.errors import ConfigError, Interrupted, PlatformError, by_caller, did_you_mean
from dealib.files import write_text
from dealib.materials.laws import LAWS, Law
from dealib.materials.published import library
from dealib.tasks.arguments import exclude, silent
from dealib.tasks.pictures import Given, as_run, as_runs

if TYPE_CHECKING:
    import pandas

    from dealib.calibration.report import Fitted
    from dealib.data.compare import Comparison
    from dealib.data.measured import Measured
    from dealib.data.table import Table
    from dealib.results.sensing import CapacitanceMap

CASES = Path("runs/studies/cases")
FIT = "fit.yaml"


def selection(file: str | Path, keys: Mapping[str, Any]) -> Selection:
    """What is taken from a data file.

    Args:
        file: The file.
        keys: Keys of a fit's data by their dotted names, such as 'prepare.force.sign'.

    Raises:
        ConfigError: If a key is wrong.
    """
    tree: dict[str, Any] = {"file": str(file)}
    for key, given in keys.items():
        *above, last = key.split(".")
        node: Any = tree
        for part in above:
            node = node.setdefault(part, {}) if isinstance(node, dict) else None
        if not isinstance(node, dict) or not last:
            raise ConfigError(f"{by_caller('--set ', '')}{key}: expected a key of a fit's data")
        node[last] = given
    try:
        return Selection.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        said = problem(dict(first), Selection)
        raise ConfigError(f"{where}: {said}" if where else said) from None


def read_data(file: str | Path, **format: Any) -> Table:
    """Read the table of a laboratory's file: text, spreadsheet or MAT file.

    Args:
        file: The file.
        format: What it does not tell: encoding, delimiter, decimal, sheet or table.

    Returns:
        The table; `.frame` is it for pandas, `.account` says how it was read.

    Raises:
        ConfigError: If it has no single reading.
    """
    from dealib.data.read import read

    return read(file, selection(file, {f"format.{k}": v for k, v in format.items()}).format)


def compare(
    run: Given,
    file: str | Path,
    x: str | None = None,
    columns: Mapping[str, str] | None = None,
    *,
    stage: str | None = None,
    ignore: Sequence[str] = (),
    set: Mapping[str, Any] | None = None,
) -> list[Comparison]:
    """Compare a run with the measured curves of a file.

    Args:
        run: The run or its directory.
        file: The data; headers such as 'force [mN]' name quantity and unit.
        x: The abscissa; default the first column.
        columns: Header of each quantity, where the file names it otherwise.
        stage: Compare with this stage only.
        ignore: Headers that are left out.
        set: Further keys of a fit's data, such as {'prepare.force.sign': -1}.

    Returns:
        A comparison for each curve, with `rmse` and `r2`.

    Raises:
        ConfigError: If data and run do not fit.
    """
    keys = {"x": x, "columns": columns, "stage": stage, "ignore": tuple(ignore), **(set or {})}
    return against(run, file, selection(file, keys))[1]


def against(
    run: Given, file: str | Path, wanted: Selection
) -> tuple[Measured, list[Comparison], dict[str, Any]]:
    """The data of a file, their comparisons with a run, and the run's history.

    Raises:
        ConfigError: If data and run do not fit.
    """
    from dealib.data.compare import compare
    from dealib.data.measured import measured

    run = as_run(run)
    history = {str(name): run.history[name].to_numpy() for name in run.history}
    numeric = [name for name, values in history.items() if values.dtype.kind in "fi"]
    data = measured(file, numeric, wanted)
    return data, compare(history, data, wanted.stage), history


def sense(runs: Given | Sequence[Given]) -> CapacitanceMap:
    """The capacitance over displacement and voltage, and displacements back from it.

    Args:
        runs: Runs with sweeps of the displacement at constant voltages.

    Raises:
        ConfigError: If they hold no map, or are not of the same device.
    """
    from dealib.results.device import check_device
    from dealib.results.sensing import CapacitanceMap

    found = as_runs(runs)
    check_device(found)
    return CapacitanceMap.of([run.history for run in found])


# --- materials -----------------------------------------------------------------------------------


def law(name: str, **parameters: Any) -> Law:
    """A law, or that of a known material.

    Args:
        name: Such as 'gent' or 'elastosil_2030'.
        parameters: With units, such as shear_modulus='0.4 MPa'; none: the law's example, or the
            material's own.

    Raises:
        ConfigError: If the law or a parameter is unknown or wrong.
    """
    entry = library().get(name)
    if name not in LAWS and entry is None:
        hint = did_you_mean(name, [*LAWS, *library()])
        raise ConfigError(f"unknown law or material {name!r}{hint}")
    kind = LAWS[name] if entry is None else entry.law
    for key, given in parameters.items():
        if key not in kind.model_fields or key == "law":
            known = (*kind.names(), "youngs_modulus")
            setting = by_caller(f"--set {key}={given}", key)
            raise ConfigError(f"{setting}: unknown parameter{did_you_mean(key, known)}")
    try:
        if entry is not None:
            return kind.model_validate(entry.with_changes(parameters, ()))
        return kind.model_validate({"law": name} | (parameters or kind.example()))
    except ValidationError as error:
        found = [
            f"{'.'.join(map(str, e['loc']))}: {e['msg'].removeprefix('Value error, ')}".lstrip(": ")
            for e in error.errors()
        ]
        raise ConfigError(f"{name}: " + "; ".join(found)) from None


def known_materials() -> pandas.DataFrame:
    """The published materials that a config can name: description, law, values and source."""
    import pandas as pd

    rows = {
        name: {"description": e.description, "law": e.values["law"], "values": e.words,
               "source": e.source}
        for name, e in library().items()
    }  # fmt: skip
    return pd.DataFrame.from_dict(rows, orient="index")


# --- fits ----------------------------------------------------------------------------------------


def calibrate(
    path: str | Path,
    directory: str | Path | None = None,
    jobs: int | None = None,
    *,
    cache: str | Path = CASES,
    resume: bool = False,
    overwrite: bool = False,
    tell: Callable[[str], None] = silent,
) -> Fitted:
    """Fit parameters of a config to measured curves, or a material to coupon tests.

    Args:
        path: The fit's YAML file.
        directory: Where its report goes; default the file's.
        jobs: Processes; default all cores. With more than one, a script guards what it does by
            `if __name__ == "__main__":`.
        cache: Folder of solved cases.
        resume: Go on with an earlier fit.
        overwrite: Replace an earlier fit.
        tell: Told how it goes on, line by line.

    Returns:
        What was found: its `table` of parameters, and `failures`, which is empty if the fit is a
        success.

    Raises:
        ConfigError: If the fit is wrong, or its directory exists.
        Interrupted: With what is kept.
    """
    from dealib.calibration.report import write_report

    exclude(overwrite, resume)
    path, given = Path(path), None if directory is None else Path(directory)
    if "tests" in Source(path).tree:
        fitted, found = _coupon(path, given, resume, overwrite, tell)
    else:
        fitted, found = _config(path, given, Path(cache), jobs, resume, overwrite, tell)
    write_report(fitted, found)
    return replace(fitted, directory=found)


def _config(
    path: Path,
    out: Path | None,
    folder: Path,
    jobs: int | None,
    resume: bool,
    over: bool,
    tell: Callable[[str], None],
) -> tuple[Fitted, Path]:
    from dealib.calibration.cases import Cases
    from dealib.calibration.fit import run_search
    from dealib.calibration.schema import Plan
    from dealib.cases.cache import Cache
    from dealib.cases.workers import Pool, cores

    plan = Plan(path)
    directory = out or Path(plan.fit.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    wanted = len(plan.fit.data) * (len(plan.fit.parameters) + 1)
    with Pool(jobs or min(cores(), wanted)) as pool:
        cases = Cases(Cache(folder), pool)
        try:
            return run_search(plan, cases, tell), directory
        except Interrupted as stop:
            on = by_caller("--resume", "resume=True")
            raise Interrupted(
                f"{stop}; the {cases.solved} cases solved now are kept, {on} goes on with them",
                stop.signal,
            ) from None


def _coupon(
    path: Path, out: Path | None, resume: bool, over: bool, tell: Callable[[str], None]
) -> tuple[Fitted, Path]:
    from dealib.calibration.coupon_data import CouponPlan
    from dealib.calibration.coupon_fit import run_coupon
    from dealib.config.library import add, read_library

    plan = CouponPlan(path)
    name, entries = plan.coupon.material_name, plan.library
    if entries is not None and entries.exists() and name in read_library(entries) and not over:
        ways = by_caller("--overwrite it", "give overwrite=True") + ", or give output.material"
        raise ConfigError(f"{entries} has a material {name!r}; {ways}")
    directory = out or Path(plan.coupon.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    fitted = run_coupon(plan, tell)
    if entries is not None and not fitted.failures:
        write_text(entries, add(entries, name, fitted.material or {}))
        tell(f"{entries}: {name}")
    return fitted, directory


def _prepare(directory: Path, fit: str, *, resume: bool, overwrite: bool) -> None:
    if directory.exists() and any(directory.iterdir() if directory.is_dir() else [directory]):
        if not (resume or overwrite):
            ways = by_caller(
                "--resume it, --overwrite it, or choose another --out",
                "give resume=True or overwrite=True, or choose another directory",
            )
            raise ConfigError(f"{directory} exists and is not empty; {ways}")
        if not (directory / FIT).is_file():
            raise ConfigError(f"{directory} is no directory of a fit; it is left as it is")
        if overwrite:
            shutil.rmtree(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {directory}: {error.strerror}") from None
    write_text(directory / FIT, fit)

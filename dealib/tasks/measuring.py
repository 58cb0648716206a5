"""Measured data, comparisons, material laws, and the capacitance as a sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from dealib.config.messages import problem
from dealib.data.schema import Selection
from dealib.errors import ConfigError, by_caller, did_you_mean
from dealib.materials.laws import LAWS, Law
from dealib.materials.published import library
from dealib.tasks.pictures import Given, as_run, as_runs

if TYPE_CHECKING:
    import pandas

    from dealib.data.compare import Comparison
    from dealib.data.measured import Measured
    from dealib.data.table import DataTable
    from dealib.results.sensing import CapacitanceMap


def selection(file: str | Path, keys: Mapping[str, Any]) -> Selection:
    """The selection of columns of a data file, and how they are prepared.

    Args:
        file: The file.
        keys: Keys of `data` of a fit by their dotted names, such as 'prepare.force.sign'.

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


def read_data(file: str | Path, **format: Any) -> DataTable:
    """Read the table of a laboratory's file: text, spreadsheet or MAT file.

    Args:
        file: The file.
        format: What the file leaves open: encoding, delimiter, decimal, sheet or table.

    Returns:
        The table; `.frame` is a pandas DataFrame of it, `.account` tells how it was read.

    Raises:
        ConfigError: If the file cannot be read, or in more than one way.
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
        columns: Header of each quantity that the file names differently.
        stage: Compare with this stage only.
        ignore: Headers that are left out.
        set: Further keys of `data` of a fit, such as {'prepare.force.sign': -1}.

    Returns:
        A comparison for each curve, with `rmse` (in the unit of the curve) and `r2`.

    Raises:
        ConfigError: If data and run cannot be compared.
    """
    keys = {"x": x, "columns": columns, "stage": stage, "ignore": tuple(ignore), **(set or {})}
    return against(run, file, selection(file, keys))[1]


def against(
    run: Given, file: str | Path, wanted: Selection
) -> tuple[Measured, list[Comparison], dict[str, Any]]:
    """The data of a file, their comparisons with a run, and the history of the run.

    Raises:
        ConfigError: If data and run cannot be compared.
    """
    from dealib.data.compare import compare
    from dealib.data.measured import measured

    run = as_run(run)
    history = {str(name): run.history[name].to_numpy() for name in run.history}
    numeric = [name for name, values in history.items() if values.dtype.kind in "fi"]
    data = measured(file, numeric, wanted)
    return data, compare(history, data, wanted.stage), history


def sense(runs: Given | Sequence[Given]) -> CapacitanceMap:
    """The capacitance as a function of displacement and voltage, and its inverse.

    Args:
        runs: Runs with sweeps of the displacement at constant voltages.

    Raises:
        ConfigError: If the sweeps give no map, or the runs differ in their device.
    """
    from dealib.results.sensing import CapacitanceMap, check_device

    found = as_runs(runs)
    check_device(found)
    return CapacitanceMap.of([run.history for run in found])


def law(name: str, **parameters: Any) -> Law:
    """A material law with its parameters.

    Args:
        name: Name of a law or of a known material, such as 'gent' or 'elastosil_2030'.
        parameters: Parameters with units, such as shear_modulus='0.4 MPa'; none: those of the
            material, or the example of the law.

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

"""Files as laboratories write them: each is read right, or refused with what to do."""

import numpy as np
import pytest
from laboratory import FAMILIES

from dealib.data.read import read
from dealib.data.schema import Format
from dealib.errors import ConfigError


def table(folder, text, name="data.csv", encoding="utf-8", **wanted):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return read(path, Format(**wanted))


def content(found):
    """Headers and values of a table."""
    return {c.header: c.values.tolist() for c in found.columns}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time [s],force [N]\n0.5,1.25\n1,2\n", {"time [s]": [0.5, 1], "force [N]": [1.25, 2]}),
        ("Zeit;Kraft\ns;mN\n0,5;1,25\n1;2\n", {"Zeit [s]": [0.5, 1], "Kraft [mN]": [1.25, 2]}),
        ("0.5 1.25\n1 2\n", {"column 1": [0.5, 1], "column 2": [1.25, 2]}),
    ],
)
def test_small_tables(tmp_path, text, expected):
    assert content(table(tmp_path, text)) == expected


def test_an_ambiguous_mark_is_refused_with_both_readings(tmp_path):
    text = "voltage [V];displacement [um]\n1.250;2.125\n2.500;3.250\n"
    with pytest.raises(ConfigError) as error:
        table(tmp_path, text)
    assert str(error.value) == (
        f"{tmp_path / 'data.csv'}: '1.250' is 1.25 with decimals or 1250 with a thousands mark; "
        "say which with format.decimal"
    )
    assert content(table(tmp_path, text, decimal="."))["voltage [V]"] == [1.25, 2.5]
    assert content(table(tmp_path, text, decimal=","))["voltage [V]"] == [1250, 2500]


@pytest.mark.parametrize("family", FAMILIES)
def test_forty_files_of_a_family_are_read_right(tmp_path, family):
    """By name, unit and value, each value to the digits that were written."""
    for seed in range(40):
        name, data, expected = FAMILIES[family](seed)
        found = table(tmp_path, data, f"{seed}_{name}")
        assert {c.header for c in found.columns} == set(expected), (seed, found.account)
        for column in found.columns:
            wanted = np.asarray(expected[column.header], dtype=float)
            assert column.values == pytest.approx(wanted, abs=1e-9, rel=1e-9, nan_ok=True), (
                seed, column.header, found.account,
            )  # fmt: skip

"""Files as laboratories write them: each is read right, or refused with what to do."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from laboratory import FAMILIES

from dealib.data.measured import measured
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


# --- single files: what is read, or what is said -------------------------------------------------

MM = {"U [kV]": [0.5, 1.0, 1.5], "u [mm]": [-1.25, -1.5, -2.0]}

READ = {
    "newline in headers": ('"U\n[kV]","u\n[mm]"\n0.5,-1.25\n1.0,-1.5\n1.5,-2\n', MM),
    "thousands, American": (
        'U [V];u [mm]\n500;-1.25\n"1,000";-1.5\n"1,500";-2.0\n',
        {"U [V]": [500, 1000, 1500], "u [mm]": [-1.25, -1.5, -2.0]},
    ),
    "thousands, German": (
        "U [V];u [mm]\n500;-1,25\n1.000;-1,5\n1.500;-2,0\n",
        {"U [V]": [500, 1000, 1500], "u [mm]": [-1.25, -1.5, -2.0]},
    ),
    "delimiter in headers": ('"U, kV";"u, mm"\n0,5;-1,25\n1,0;-1,5\n1,5;-2\n', MM),
    "dash for no unit": (
        "U [kV],l [-]\n0.5,1.2\n1,1.3\n",
        {"U [kV]": [0.5, 1], "l [-]": [1.2, 1.3]},
    ),
    "Excel names the delimiter": ("sep=;\nU [kV];u [mm]\n0,5;-1,25\n1,0;-1,5\n1,5;-2\n", MM),
    "delimiter behind the rows only": ("U [kV];u [mm]\n0,5;-1,25;\n1,0;-1,5;\n1,5;-2;\n", MM),
    "statistics below": ("U [kV];u [mm]\n0,5;-1,25\n1,0;-1,5\n1,5;-2\nMean;-1,58\n", MM),
    "a rule below the header": (
        "U [kV]  u [mm]\n------  ------\n0.5  -1.25\n1.0  -1.5\n1.5 -2\n",
        MM,
    ),
    "blank lines between all": ("U [kV],u [mm]\r\r\n0.5,-1.25\r\r\n1,-1.5\r\r\n1.5,-2\r\r\n", MM),
    "autoranging meter": (
        "No.,Value,Unit\n1,900.5,mV\n2,1.25,V\n3,1.5,V\n",
        {"No.": [1, 2, 3], "Value [mV]": [900.5, 1250, 1500]},
    ),
    "units in the cells": (
        "t [s];U\n1;900 mV\n2;1.25 V\n",
        {"t [s]": [1, 2], "U [mV]": [900, 1250]},
    ),
    "Fortran's exponents": (
        "1.5D+01 2.5D-01\n2.0D+01 3.0D-01\n",
        {"column 1": [15, 20], "column 2": [0.25, 0.3]},
    ),
    "mojibake": ("x [Âµm];F [N]\n1;2\n3;4\n", {"x [Âµm]": [1, 3], "F [N]": [2, 4]}),
    "repaired by zeros": ("U [kV],u [mm]\n0.5,-1.25\n1,-1.5\n1.5,-2\n\0\0\0\0", MM),
    "a scanner's times": (
        "t,u [mm]\n05/06/2024 10:11:12:250,1\n05/06/2024 10:11:13:000,-FFFFFFF\n"
        "05/06/2024 10:11:13:250,3\n",
        {"t [s]": [0, 0.75, 1], "u [mm]": pytest.approx([1, np.nan, 3], nan_ok=True)},
    ),
    "PicoScope": (
        "Time,Channel A,Channel B\n(ms),(V),(mV)\n\n0.0,1.5,2\n0.1,2.5,-∞\n0.2,3.5,1\n",
        {
            "Time [ms]": [0, 0.1, 0.2],
            "Channel A [V]": [1.5, 2.5, 3.5],
            "Channel B [mV]": pytest.approx([2, np.nan, 1], nan_ok=True),
        },
    ),
    "MTS TestSuite": (
        "MTS793|BTW|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition: Timed\tTime: 12.5 Sec\n"
        "Station Name: one\n\nAxial Displacement\tAxial Force\tRunning Time\nmm\tN\ts\n"
        "0.1\t1.5\t0\n0.2\t2.5\t1\n",
        {
            "Axial Displacement [mm]": [0.1, 0.2],
            "Axial Force [N]": [1.5, 2.5],
            "Running Time [s]": [0, 1],
        },
    ),
    "a rheometer": (
        "Test:\tone\n\nInterval data:\tPoint No.\tTime\tStrain\n\t\t[s]\t[%]\n\t1\t0,5\t12,5\n"
        "\t2\t1,5\t13,5\n",
        {"Point No.": [1, 2], "Time [s]": [0.5, 1.5], "Strain [%]": [12.5, 13.5]},
    ),
    "Origin with labels of rows": (
        "\tA\tB\nLong Name\tTime\tForce\nUnits\ts\tN\nComments\t\t\nF(x)=\t\t\n1\t0.5\t2.5\n"
        "2\t1.5\t3.5\n",
        {"column 1": [1, 2], "Time [s]": [0.5, 1.5], "Force [N]": [2.5, 3.5]},
    ),
    "numpy.savetxt": (
        "# time [s] force [N]\n1.5e+00 2.5e+00\n2.5e+00 3.5e+00\n",
        {"time [s]": [1.5, 2.5], "force [N]": [2.5, 3.5]},
    ),
    "date and time apart": (
        "Date Time U\n2024-05-06 23:59:59 1.5\n2024-05-07 00:00:01 2.5\n",
        {"Date [s]": [0, 86400], "Time [s]": [0, 2], "U": [1.5, 2.5]},
    ),
}


@pytest.mark.parametrize("name", READ)
def test_read_right(tmp_path, name):
    text, expected = READ[name]
    found = table(tmp_path, text)
    assert content(found) == expected, found.account


TWO_TABLES = "{} tables (1: lines {}; 2: lines {}): choose with format.table"
HEADERS = (
    "{}: {} headers for {} columns of numbers; put headers that contain a comma or a "
    "blank in quotes, and separate numbers with decimal commas by another delimiter"
)

COMMAS = (
    ":1: the commas of '{}' may separate columns, decimals or thousands; if all of them separate "
    "columns, set format.decimal to '.', otherwise add a line of headers"
)

REFUSED = {
    "open quote": ('"U [kV],u [mm]\n0.5,1\n1,2\n', ":1: a quote is opened and never closed"),
    "open quote below": (
        'U [kV],u [mm]\n0.5,"1\n1,2\n2,3\n',
        ":2: a quote is opened and never closed",
    ),
    "commas for all": ("U [kV],u [mm]\n0,5,-1,25\n1,0,-1,5\n", HEADERS.format(":1", 2, 4)),
    "commas for all, no header": ("0,5,-1,25\n1,0,-1,5\n", COMMAS.format("0,5,-1,25")),
    "commas for all, and blanks": ("0,5, 1.2\n1,0, 1.5\n", COMMAS.format("0,5, 1.2")),
    "thousands in all rows": ("0.5,1,900.5\n1.0,2,000.5\n", COMMAS.format("0.5,1,900.5")),
    "thousands in some rows": ("0.5,900.5\n1.0,1,000.5\n", COMMAS.format("0.5,900.5")),
    "thousands without quotes": ("U [V],u [mm]\n500,1.5\n1,000,2.5\n", HEADERS.format(":1", 2, 3)),
    "names of rows without a header": (
        "U [kV] u [mm]\n1 0.5 1.5\n2 0.6 1.6\n",
        HEADERS.format(":1", 2, 3),
    ),
    "both marks": (
        "U [kV];u [mm]\n0.5;1,5\n1.5;2,5\n",
        ": both '0.5' and '1,5' have decimals; say which with format.decimal",
    ),
    "whole thousands or three decimals": (
        "U [V];u [mm]\n12,345;1\n13,456;2\n",
        ": '12,345' is 12.345 with decimals or 12345 with a thousands mark; say which with "
        "format.decimal",
    ),
    "another mark in one row": (
        "U [V];u [mm]\n0.5;1\n0,75;2\n1.5;3\n",
        ": both '0.5' and '0,75' have decimals; say which with format.decimal",
    ),
    "a word": ("U [V],u [mm]\n1,2\n2,x\n3,4\n", ":3: u [mm]: 'x' is no number"),
    "the logger began anew": (
        "U [V],u [mm]\n1,2\n2,3\nU [V],u [mm]\n1,2\n2,3\n",
        ": " + TWO_TABLES.format(2, "2 to 3", "5 to 6"),
    ),
    "gnuplot's data sets": (
        "# U u\n0 1\n1 2\n\n\n0 1\n1 3\n",
        ": " + TWO_TABLES.format(2, "2 to 3", "6 to 7"),
    ),
    "hours or minutes": (
        "t,u [mm]\n10:15,1\n10:16,2\n",
        ": column 't': '10:15' may be min:s or h:min; write the unit as [mm:ss] or [hh:mm]",
    ),
    "day or month": (
        "t,u [mm]\n05/06/2024 23:59:59,1\n06/06/2024 00:00:01,2\n",
        ": column 't': '05/06/2024 23:59:59' may begin with the day or the month",
    ),
    "a blank cell between blanks": (
        "t  U  F\n1  2  3\n2     4\n3  4  5\n",
        ":3: 2 values for 3 columns",
    ),
    "some cells with a unit": (
        "t [s];U [V]\n1;900 mV\n2;1.25\n3;1.5\n",
        ": column 'U [V]': some cells have a unit, others have none",
    ),
    "units of two kinds": (
        "t [s];U\n1;900 mV\n2;1.25 N\n",
        ": column 'U': cells in mV and in N in one column",
    ),
    "words": ("Hello\nworld\n", ": expected a header line and at least two lines of numbers"),
    "nothing": ("\n \n", ": the file is empty"),
    "a picture": (b"\x89PNG\r\n\x1a\n123", ": a picture: a plot digitiser makes a table of it"),
    "LabVIEW's binary": (b"TDSm\x0e\0\0\0", ": a TDMS file of LabVIEW: save it as LVM or as text"),
    "binary": (
        bytes(range(256)),
        ": a binary file; export it as text, as a spreadsheet (XLSX, XLS, ODS) or as a MAT file",
    ),
    "a damaged spreadsheet": (
        b"PK\x03\x04junk",
        ": cannot be read as a spreadsheet: File is not a zip file",
    ),
    "a damaged MAT file": (
        b"MATLAB 5.0 MAT-file" + b"x" * 200,
        ": cannot be read as a MAT file: Unknown mat file type, version 120, 120",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_what_to_do(tmp_path, name):
    text, said = REFUSED[name]
    with pytest.raises(ConfigError) as error:
        table(tmp_path, text)
    assert str(error.value) == f"{tmp_path / 'data.csv'}{said}"


def test_what_is_chosen_resolves_what_is_refused(tmp_path):
    two = "U [V],u [mm]\n1,2\n2,3\nU [V],u [mm]\n1,4\n2,5\n"
    assert content(table(tmp_path, two, table=2)) == {"U [V]": [1, 2], "u [mm]": [4, 5]}
    with pytest.raises(
        ConfigError, match="there is no table 3; it has 1: lines 2 to 3; 2: lines 5"
    ):
        table(tmp_path, two, table=3)
    whole = "0,5,-1,25\n1,0,-1,5\n"
    assert len(table(tmp_path, whole, decimal=".").columns) == 4
    cyrillic = "Сила [N];t [s]\n1;2\n3;4\n".encode("cp1251")
    (tmp_path / "data.csv").write_bytes(cyrillic)
    found = read(tmp_path / "data.csv", Format(encoding="cp1251"))
    assert found.columns[0].name == "Сила"
    with pytest.raises(ConfigError, match="unknown encoding 'utf-99'; known are, for"):
        read(tmp_path / "data.csv", Format(encoding="utf-99"))


def test_percent_of_a_spreadsheet_is_what_it_shows(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["Time [s]", "Strain [%]", "Damage [%]"])
    for i in range(3):
        book.active.append([i, 0.125 * i, 2.0 * i])
        book.active.cell(i + 2, 2).number_format = "0.0%"
    book.save(tmp_path / "a.xlsx")
    found = content(read(tmp_path / "a.xlsx"))
    assert found == {"Time [s]": [0, 1, 2], "Strain [%]": [0, 12.5, 25], "Damage [%]": [0, 2, 4]}


def test_no_file_is_read_without_end(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name, said in (("pipe", "no file"), ("none", "there is no such file"), (".", "a folder")):
        with pytest.raises(ConfigError, match=said):
            read(tmp_path / name)
    with pytest.raises(ConfigError, match="no file"):
        read("/dev/zero")


def test_units_of_headers_in_capitals_may_be_two(tmp_path):
    found = table(tmp_path, "TIME [S];FORCE [MN];U [KV]\n1;2;3\n2;3;4\n")
    time, force, voltage = found.columns
    assert time.in_unit("s").tolist() == [1, 2]
    assert voltage.in_unit("V").tolist() == [3000, 4000]
    with pytest.raises(ValueError, match="in capitals, the unit may be MN or mN; say which"):
        force.in_unit("N")


def million(tmp_path):
    """Read a million rows in a process: points, mean, processor time (s), memory (MB).

    The peak is the process's own (VmHWM): ``ru_maxrss`` counts what the process that started it
    had used, and a test suite uses much.
    """
    i = np.arange(1_000_000)
    columns = [i * 1e-3, -2 * np.sin(i * 1e-5), 0.3 * np.cos(i * 1e-5)]
    path = tmp_path / "long.csv"
    with path.open("w") as file:
        file.write("time [s];displacement [mm];force [N]\n")
        for part in np.array_split(np.column_stack(columns), 100):
            np.savetxt(file, part, "%.6f", ";")
    path.write_text(path.read_text().replace(".", ","))
    code = (
        "import sys, time; from dealib.data.measured import measured\n"
        "from dealib.data.schema import Selection\n"
        "names = ['time_s', 'displacement_mm', 'force_N']\n"
        "m = measured(sys.argv[1], names, Selection(file='x', x='displacement', resample=1000))\n"
        "print(len(m.columns['force_N']), m.columns['force_N'].mean())\n"
        "peak = next(line for line in open('/proc/self/status') if line.startswith('VmHWM'))\n"
        "print(time.process_time(), int(peak.split()[1]) / 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    return [*map(float, done.stdout.split()), float(np.mean(columns[2]))]


@pytest.mark.once
def test_a_million_rows_in_500_mb(tmp_path):
    points, mean, _, memory, exact = million(tmp_path)
    assert points == pytest.approx(1000, abs=5)
    assert mean == pytest.approx(exact, abs=1e-3)
    assert memory < 500


@pytest.mark.slow
def test_a_million_rows_in_five_seconds(tmp_path):
    """With the import of pandas; slow, since it wants a machine that is not busy."""
    assert million(tmp_path)[2] < 5


# --- files that were sent in ---------------------------------------------------------------------

SENT = Path(os.environ.get("DEALIB_DATA", Path(__file__).parents[2] / "shared" / "data")).parent
SENT = SENT / "cases" / "data-files"
FIRST_ROWS = {
    "D12_units_row.csv": {"Zeit [s]": 0.0, "Kraft [N]": 1.5},
    "D15_dash_unit.csv": {"voltage [kV]": 0.25, "stretch_max [-]": 1.2},
    "D16_overload_9.9E37.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "D1_newline_header.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "D1b_open_quote.csv": ":1: a quote is opened and never closed",
    "D2_thousands_us.csv": {"voltage [V]": 500.0, "displacement [mm]": -2.28838},
    "D2b_thousands_de.csv": {"voltage [V]": 500.0, "displacement [mm]": -2.28838},
    "D3_same_quantity_twice.csv": "columns 'displacement [mm]' and 'Displacement [um]' are both "
    "displacement",
    "D4_positive_push.csv": {"displacement [mm]": 0.5, "force [N]": 0.058},
    "D5_x_noise_loading_only.csv": {"displacement [mm]": 0.0371375, "force [N]": 1.12289e-29},
    "D6_comma_in_header.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "D7_two_brackets.csv": {"voltage (ch 1) [kV]": 0.25, "displacement [mm]": -2.2735},
    "D8_typographic_minus.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "D9_trailing_columns.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "M1_latin1_micro.csv": {"Voltage [V]": 250.0, "Displacement [µm]": -2273.5},
    "M2_tab_decimal_comma.txt": {
        "time [s]": 16.0,
        "voltage [kV]": 0.25,
        "displacement [mm]": -2.2735,
    },
    "M3_bluehill.csv": {"Time [s]": 1.0, "Displacement [mm]": -0.46822, "Force [N]": -0.04},
    "M4_comsol.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "M5_wpd_all.csv": {"run1 X": 0.25, "run1 Y": -2.274, "run2 X": 0.25, "run2 Y": -2.274},
    "M6.lvm": {"time [s]": 16.0, "Voltage": 0.25, "Displacement": -2.2735},
    "M7_empty_cell.csv": {"voltage [kV]": 0.25, "displacement [mm]": -2.2735},
    "M8_hms.csv": {"time [s]": 0.0, "displacement [mm]": -2.2735},
    "a_pos.csv": {"Voltage [V]": 0.0, "Load cell [mN]": 533.87},
    "o_side.csv": {"V1 [V]": 0.0, "F1 [mN]": -533.87, "V2 [V]": 0.0, "F2 [mN]": -544.547},
}


@pytest.mark.skipif(not SENT.is_dir(), reason="the files are not here")
@pytest.mark.parametrize("name", FIRST_ROWS)
def test_files_that_were_sent_in(name):
    expected = FIRST_ROWS[name]
    if isinstance(expected, str):
        with pytest.raises(ConfigError) as error:
            measured(SENT / name, ["voltage_kV", "displacement_mm"])
        assert expected in str(error.value)
    else:
        found = read(SENT / name)
        assert {c.header: c.values[0] for c in found.columns} == expected


@pytest.mark.skipif(not SENT.is_dir(), reason="the files are not here")
def test_no_file_that_was_sent_in_is_forgotten():
    tables = {p.name for p in SENT.iterdir() if p.suffix in (".csv", ".txt", ".lvm")}
    assert tables <= set(FIRST_ROWS)


def test_random_tables_are_read_right_or_refused(tmp_path):
    """Any delimiter with any marks, sensible or not: no number may be wrong without a word."""
    rng = np.random.default_rng(2026)
    refused = dict.fromkeys((True, False), 0)
    for _ in range(400):
        by, decimal = rng.choice([",", ";", "\t", " ", "|", ", ", "  "]), rng.choice([".", ","])
        group = {".": ",", ",": "."}[decimal] if rng.random() < 0.25 else ""
        columns, texts = [], []
        rows = int(rng.integers(3, 25))
        for _ in range(int(rng.integers(2, 5))):
            digits = int(rng.integers(0, 5))
            values = np.round(rng.normal(size=rows) * 10.0 ** rng.integers(-1, 5), digits)
            columns.append(np.abs(values) if rng.random() < 0.5 else values)
            written = [f"{v:,.{digits}f}".replace(",", "~") for v in columns[-1]]
            texts.append([w.replace(".", decimal).replace("~", group) for w in written])
        lines = [list(row) for row in zip(*texts, strict=True)]
        if rng.random() < 0.6:
            lines.insert(0, [f"x{i} [mm]" for i in range(len(columns))])
        try:
            found = table(tmp_path, "".join(by.join(line) + "\n" for line in lines))
        except ConfigError:
            refused["," in by] += 1
            continue
        assert len(found.columns) == len(columns), found.account
        for column, values in zip(found.columns, columns, strict=True):
            assert column.values == pytest.approx(values, abs=1e-9), found.account
    assert refused[False] <= 10  # whole numbers of three digits behind every mark

"""Writes data files as laboratory programs do, with what a reader must find in them."""

import datetime
import io

import numpy as np
import openpyxl
import scipy.io

NAMES = [("Time", "s"), ("Displacement", "mm"), ("Force", "N"), ("Voltage", "kV")]


class Made:
    """Random columns, and helpers to write them.

    Args:
        seed: Decides on everything.
    """

    def __init__(self, seed, columns=None, rows=None):
        self.rng = np.random.default_rng(seed)
        n = rows or int(self.rng.integers(6, 40))
        k = columns or int(self.rng.integers(2, 5))
        self.names = NAMES[:k]
        t = np.arange(n) * float(self.pick([0.1, 0.25, 0.05]))
        u = -2.5 * np.sin(t * 0.7) + self.rng.normal(0, 0.01, n)
        waves = [t, u, 0.3 * u + 0.05 * u**3, 2.5 * np.abs(np.sin(t))]
        self.columns = [np.round(w, 5) for w in waves[:k]]

    def pick(self, options):
        return options[int(self.rng.integers(len(options)))]

    def maybe(self, share=0.5):
        return bool(self.rng.random() < share)

    def number(self, value, decimal=".", style=None):
        text = {None: f"{value:.5f}", "short": f"{value:.7g}", "e": f"{value:.6E}"}[style]
        return text.replace(".", decimal)

    def rows(self, decimal=".", style=None):
        table = zip(*self.columns, strict=True)
        return [[self.number(v, decimal, style) for v in row] for row in table]

    def expected(self):
        pairs = zip(self.names, self.columns, strict=True)
        return {f"{name} [{unit}]": values for (name, unit), values in pairs}

    def heads(self, pattern="{} [{}]"):
        return [pattern.format(*n) for n in self.names]


def joined(rows, by, end="\n"):
    return "".join(by.join(row) + end for row in rows)


def dialect(made):
    """A delimiter and a decimal mark that go together."""
    return made.pick([(",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", "."), ("|", ".")])


def encodings(seed):
    made = Made(seed, columns=3)
    by, decimal = dialect(made)
    code, words = made.pick(
        [
            ("utf-8", "Größe"),
            ("utf-8-sig", "Größe"),
            ("utf-16", "Größe"),
            ("utf-16-le", "Größe"),
            ("utf-16-be", "Größe"),
            ("cp1252", "Größe"),
            ("latin-1", "Kraft°"),
            ("cp850", "Größe"),
            ("gb18030", "位移"),
            ("shift_jis", "変位"),
            ("utf-32", "Größe"),
            ("latin-1", "Effort"),
            ("cp1252", "Prüfkraft"),
            ("utf-8", "力"),
        ]
    )
    micro = made.pick("µμ") if "utf" in code else {"gb18030": "μ", "shift_jis": "μ"}.get(code, "µ")
    names = [("Zeit", "s"), ("Weg", f"{micro}m"), (words, "N")]
    heads = [f"{n} [{u}]" for n, u in names]
    text = joined([heads, *made.rows(decimal)], by, made.pick(["\n", "\r\n", "\r"]))
    return "data.csv", text.encode(code), dict(zip(heads, made.columns, strict=True))


def delimiters(seed):
    made = Made(seed)
    by, decimal = made.pick(
        [
            (",", "."),
            (";", ","),
            (";", "."),
            ("\t", ","),
            ("\t", "."),
            ("|", "."),
            ("|", ","),
            ("   ", "."),
            ("  ", ","),
            (", ", "."),
            (" ; ", ","),
            ("\t ", "."),
            ('","', ","),
            ('","', "."),
        ]
    )
    rows = [made.heads(made.pick(["{} [{}]", "{} ({})", "{}_{}"])), *made.rows(decimal)]
    if by == '","':
        text = joined([['"' + by.join(r) + '"'] for r in rows], "")
    else:
        lead = made.pick(["", "  "]) if not by.strip() and "\t" not in by else ""
        text = "".join(lead + by.join(r) + "\n" for r in rows)
    return "data.txt", text.encode(), made.expected()


def decimals(seed):
    made = Made(seed, columns=3)
    by, decimal = made.pick([(";", ","), (";", "."), ("\t", ","), ("\t", "."), ('","', ",")])
    group = made.pick([{",": ".", ".": ","}[decimal], " ", "\u00a0", "\u202f", "'", "’", "\u2009"])
    made.columns[0] = np.round(made.columns[0] * 4e4)  # a column of large whole numbers
    made.columns[1] = np.round(made.columns[1], 4)
    made.columns[2] = np.round(made.columns[2] * 1e5, 2)  # and one with marks of both kinds
    digits = [0, 4, 2]
    rows = [
        [
            f"{v:,.{d}f}".replace(",", "~").replace(".", decimal).replace("~", group)
            for v, d in zip(row, digits, strict=True)
        ]
        for row in zip(*made.columns, strict=True)
    ]
    text = joined([made.heads(), *rows], by)
    if by == '","':
        text = joined([['"' + by.join(r) + '"'] for r in [made.heads(), *rows]], "")
    return "data.csv", text.encode(), made.expected()


def unit_rows(seed):
    made = Made(seed)
    by, decimal = dialect(made)
    around = made.pick(["{}", "[{}]", "({})", "{{{}}}"])
    above = [[n for n, _ in made.names], [around.format(u) for _, u in made.names]]
    if made.maybe(0.3):
        above.append([f"run {k}" for k in range(len(made.names))])
    if made.maybe(0.3):
        above.insert(0, list("ABCD")[: len(made.names)])
    return "data.csv", joined([*above, *made.rows(decimal)], by).encode(), made.expected()


def header_units(seed):
    made = Made(seed)
    pattern = made.pick(
        [
            "{} [{}]",
            "{} ({})",
            "{}({})",
            "{} / {}",
            "{}/{}",
            "{} in {}",
            "{}, {}",
            "{}_{}",
            "{} {}",
            "{} <{}>",
            "{} {{{}}}",
            "{} (ch 1) [{}]",
            "  {}  [ {} ]",
        ]
    )
    by = made.pick([";", "\t"])
    expected = made.expected()
    if "ch 1" in pattern:
        expected = {k.replace(" [", " (ch 1) ["): v for k, v in expected.items()}
    return "data.csv", joined([made.heads(pattern), *made.rows()], by).encode(), expected


def metadata(seed):
    made = Made(seed)
    by, decimal = dialect(made)
    known = [
        "Test report",
        f"Operator{by}A. Müller",
        f"Date{by}2024-05-06",
        'Specimen: 5" strip',
        f"Sample rate{by}1000{by}Hz",
        "Width = 10 mm",
        f"Load cell{by}{made.number(2.5, decimal)}{by}kN",
        "==========",
        f"Temperature{by}23",
        "No. of cycles: 3",
        "----------",
        f"Gain{by}1{by}2",
        "Comment: first try, see 3.2",
        f"Channels{by}2",
        "Serial,0815;x",
        f"{by}{by}",
        "Software 7.1",
    ]
    lines = made.rng.permutation(known)[: int(made.rng.integers(1, len(known) + 1))]
    mark = made.pick(["", "", "# ", "% ", "// "])
    text = "".join(f"{mark}{line}\n" for line in lines) + (
        "\n" if made.maybe(0.7) or not mark else ""
    )
    return (
        "data.csv",
        (text + joined([made.heads(), *made.rows(decimal)], by)).encode(),
        made.expected(),
    )


def lvm(seed):
    made = Made(seed, columns=3)
    by, decimal = made.pick([("\t", ","), ("\t", "."), (",", ".")])
    of_x, units = made.pick(["One", "No", "Multi"]), made.maybe()
    n, channels = len(made.columns[0]), made.names[1:]
    step = made.columns[0][1]
    two = [
        ["X0", "0", "0"],
        ["Delta_X", made.number(step, decimal, "e"), made.number(step, decimal, "e")],
    ]
    if units:
        two.insert(0, ["Y_Unit_Label", *(u for _, u in channels)])
    head = [
        ["LabVIEW Measurement"],
        ["Writer_Version", "2"],
        ["Reader_Version", "2"],
        ["Separator", {"\t": "Tab", ",": "Comma"}[by]],
        ["Decimal_Separator", decimal],
        ["Multi_Headings", "No"],
        ["X_Columns", of_x],
        ["Time_Pref", "Absolute"],
        ["Operator", "lab"],
        ["Date", "2016/08/11"],
        ["Time", f"14:37:48{decimal}2"],
        ["***End_of_Header***", ""],
        [""],
        ["Channels", "2", "", ""],
        ["Samples", str(n), str(n), ""],
        ["Date", "2016/08/11", "2016/08/11"],
        ["Time", f"14:37:48{decimal}2", f"14:37:48{decimal}2"],
        ["X_Dimension", "Time", "Time"],
        *two,
        ["***End_of_Header***", "", "", ""],
    ]
    rows = made.rows(decimal)
    names = [n for n, _ in channels]
    if of_x == "Multi":
        heads = ["X_Value", names[0], "X_Value", names[1], "Comment"]
        rows = [[t, a, t, b] for t, a, b in rows]
    else:
        heads = ["X_Value", *names, "Comment"]
        rows = rows if of_x == "One" else [["", *row[1:]] for row in rows]
    expected = {"time [s]": made.columns[0]}
    if of_x == "Multi":
        expected["time (2) [s]"] = made.columns[0]
    for (name, unit), values in zip(channels, made.columns[1:], strict=True):
        expected[f"{name} [{unit}]" if units else name] = values
    text = joined([*head, heads, *rows], by, made.pick(["\n", "\r\n"]))
    return "data.lvm", text.encode(), expected


def comsol(seed):
    made = Made(seed)
    table = made.maybe()
    by = made.pick([",", "      ", "   "])
    heads = by.join(made.heads("{} ({})"))
    lines = ["% Model:,dea.mph", "% Version:,COMSOL 6.1.0.252", '% Date:,"May 6 2024, 10:11"']
    if by != ",":
        lines = [line.replace(":,", ":              ") for line in lines]
    if table:
        lines.append("% Table:              Table 1 - Global Evaluation 1")
    rows = made.rows(style=made.pick([None, "short", "e"]))
    text = "\n".join([*lines, "% " + heads, *(by.join(r) for r in rows)]) + "\n"
    return made.pick(["data.txt", "data.csv"]), text.encode(), made.expected()


def origin(seed):
    made = Made(seed)
    decimal = made.pick([".", ","])
    k = len(made.names)
    above = [[n for n, _ in made.names], [u for _, u in made.names]]
    if made.maybe():
        above.append(made.pick([[""] * k, ["", *["sample 1"] * (k - 1)]]))
    if made.maybe():
        above.insert(0, ["A(X)", "B(Y)", "C(Y)", "D(Y)"][:k])
    text = joined([*above, *made.rows(decimal, made.pick([None, "short"]))], "\t", "\r\n")
    return "data.dat", text.encode("cp1252"), made.expected()


def bluehill(seed):
    made = Made(seed, columns=3, rows=int(np.random.default_rng(seed).integers(30, 60)))
    by, decimal = made.pick([(",", "."), (";", ","), (",", ",")])
    quoted = made.maybe() or decimal == by

    def line(cells):
        return by.join(f'"{c}"' if quoted else c for c in cells) + "\n"

    text = line(["Specimen label : ", "A1"]) + line(["Rate 1 : ", "10", "mm/min"])
    if made.maybe():
        text += line(["Results Table 1"]) + line(["", "Maximum Load", "Extension at Break"])
        text += line(["", "(N)", "(mm)"]) + line(
            ["1", made.number(2.5, decimal), made.number(3.1, decimal)]
        )
    text += made.pick(["\n", "\n\n", line(["Raw Data"])])
    text += line([n for n, _ in made.names]) + line([f"({u})" for _, u in made.names])
    return (
        "A1.csv",
        (text + "".join(line(r) for r in made.rows(decimal))).encode("utf-8-sig"),
        made.expected(),
    )


def digitiser(seed):
    made = Made(seed, columns=2)
    by, decimal = made.pick([(",", "."), (";", ","), ("\t", ".")])
    curves = int(made.rng.integers(2, 5))
    n = len(made.columns[0])
    lengths = [n, *made.rng.integers(3, n + 1, curves - 1).tolist()]
    rows = []
    for i, (x, y) in enumerate(made.rows(decimal)):
        cells = [c for m in lengths for c in ((x, y) if i < m else ("", ""))]
        if made.maybe(0.2):
            while cells[-1] == "":  # some programs write no empty ends
                cells.pop()
        rows.append(cells)
    names = [f"rate {k}" for k in range(1, curves + 1)]
    above = [[c for name in names for c in (name, "")], ["X", "Y"] * curves]
    expected = {}
    for name, m in zip(names, lengths, strict=True):
        for axis, values in zip("XY", made.columns, strict=True):
            expected[f"{name} {axis}"] = np.where(np.arange(n) < m, values, np.nan)
    return "wpd.csv", joined([*above, *rows], by).encode(), expected


def spreadsheet(seed):
    made = Made(seed)
    book = openpyxl.Workbook()
    sheet = book.active
    for _ in range(int(made.rng.integers(0, 4))):
        sheet.append([made.pick(["Report", "Specimen A1", None]), made.pick([None, "x"])])
    if made.maybe(0.7) and sheet.max_row > 1:
        sheet.append([])
    shift = [None] * int(made.rng.integers(0, 2))
    expected = made.expected()
    if made.maybe():
        sheet.append([*shift, *made.heads()])
    else:
        sheet.append([*shift, *(n for n, _ in made.names)])
        sheet.append([*shift, *(u for _, u in made.names)])
    as_clock, as_text = made.maybe(0.3), made.maybe(0.2)
    start = datetime.datetime(2024, 5, 6, 10, 11, 12)
    for i, row in enumerate(zip(*made.columns, strict=True)):
        cells = [float(v) for v in row]
        if as_clock:
            cells[0] = start + datetime.timedelta(seconds=i)
        if as_text:
            cells[1] = made.number(cells[1], ",")
        sheet.append([*shift, *cells, *(["ok"] if made.maybe(0.3) else [])])
    if as_clock:
        expected["Time [s]"] = np.arange(len(made.columns[0]), dtype=float)
    book.create_sheet("Notes").append(["made", "for a test"])
    stream = io.BytesIO()
    book.save(stream)
    return "data.xlsx", stream.getvalue(), expected


def mat(seed):
    made = Made(seed, rows=12)
    kind = made.pick(["vectors", "rows", "struct", "matrix", "columns"])
    vectors = {f"{n}_{u}": v for (n, u), v in zip(made.names, made.columns, strict=True)}
    expected = made.expected()
    if kind == "rows":
        vectors = {n: v[None, :] for n, v in vectors.items()}
    if kind == "columns":
        vectors = {n: v[:, None] for n, v in vectors.items()}
    if kind == "struct":
        vectors = {"run": dict(vectors)}
        expected = {f"run.{k}": v for k, v in expected.items()}
    if kind == "matrix":
        vectors = {"data": np.column_stack(made.columns)}
        expected = {f"data {i}": v for i, v in enumerate(made.columns, start=1)}
    stream = io.BytesIO()
    more = {"fs": 1000.0, "name": "specimen", "note": np.array(["a", "b"], dtype=object)}
    scipy.io.savemat(stream, {**vectors, **more}, do_compression=made.maybe())
    return "data.mat", stream.getvalue(), expected


def clocks(seed):
    made = Made(seed, columns=2)
    n = len(made.columns[0])
    by, decimal = made.pick([(",", "."), (";", ","), ("\t", ".")])
    step = made.pick([1.0, 0.5, 60.0, 0.001])
    start = datetime.datetime(2024, 5, 16, *made.pick([(10, 15, 48), (23, 59, 58), (9, 5, 0)]))
    pattern = made.pick(
        [
            "%H:%M:%S.%f",
            "%Y-%m-%d %H:%M:%S.%f",
            "%d.%m.%Y %H:%M:%S.%f",
            "%m/%d/%Y %I:%M:%S.%f %p",
            "%Y-%m-%dT%H:%M:%S.%fZ",
            "%Y/%m/%d %H:%M:%S.%f",
            "watch",
            "minutes",
        ]
    )
    seconds = step * np.arange(n)
    if pattern == "watch":
        texts = [f"{s // 3600:.0f}:{s % 3600 // 60:02.0f}:{s % 60:06.3f}" for s in seconds]
    elif pattern == "minutes":
        texts = [f"{s // 60:02.0f}:{s % 60:06.3f}" for s in seconds]
    else:
        moments = [start + datetime.timedelta(seconds=float(s)) for s in seconds]
        texts = [m.strftime(pattern) for m in moments]
    texts = [t.replace(".", decimal) if not pattern.startswith("%d") else t for t in texts]
    head = made.pick(["Time", "Time [s]", "Time [hh:mm:ss]", "Time (h:m:s)"])
    rows = [[t, row[1]] for t, row in zip(texts, made.rows(decimal), strict=True)]
    data = joined([[head, "Displacement [mm]"], *rows], by).encode()
    return (
        "data.csv",
        data,
        {"Time [s]": seconds, "Displacement [mm]": made.columns[1]},
    )


def overloads(seed):
    made = Made(seed)
    by, decimal = dialect(made)
    rows = made.rows(decimal)
    words = [
        "",
        "",
        "NaN",
        "9.9E37",
        "9.90000E+37",
        "-9.9E+37",
        "OL",
        "OVLD",
        "Overload",
        "----",
        "-",
        "#N/A",
        "n/a",
        "inf",
        "-INF",
        "1.#QNAN",
        "####",
        "9.91E+37",
        "#DIV/0!",
        "Over Range",
    ]
    for _ in range(int(made.rng.integers(1, 4))):
        i, j = int(made.rng.integers(len(rows))), int(made.rng.integers(1, len(rows[0])))
        rows[i][j] = made.pick(words).replace(".", decimal)
        made.columns[j] = np.where(np.arange(len(rows)) == i, np.nan, made.columns[j])
    return "data.csv", joined([made.heads(), *rows], by).encode(), made.expected()


def minuses(seed):
    made = Made(seed)
    by, decimal = dialect(made)
    minus = made.pick("−–‐﹣")
    rows = [[c.replace("-", minus) for c in row] for row in made.rows(decimal)]
    return (
        "data.csv",
        joined([made.heads(), *rows], by).encode(made.pick(["utf-8", "utf-16"])),
        made.expected(),
    )


def trailing(seed):
    made = Made(seed)
    by, decimal = made.pick([(",", "."), (";", ","), ("\t", ".")])
    more = int(made.rng.integers(0, 3))
    heads = [*made.heads(), *[""] * more]
    rows = [[*row, *[""] * more] for row in made.rows(decimal)]
    expected = made.expected()
    if made.maybe(0.3):  # a column of words
        heads.insert(1, "Mode")
        rows = [[row[0], made.pick(["ramp", "hold"]), *row[1:]] for row in rows]
    text = joined([heads, *rows], by)
    if made.maybe(0.3):
        lines = text.splitlines(keepends=True)
        lines.insert(int(made.rng.integers(2, len(lines))), made.pick(["\n", "# pause\n", "\n"]))
        text = "".join(lines)
    text += made.pick(
        ["", "\n\n\n", f"{by * (len(heads) - 1)}\n", "End of file\n", "\nMaximum: 3\n", "\x1a"]
    )
    return "data.csv", text.encode(), expected


def oscilloscopes(seed):
    made = Made(seed, columns=2, rows=30)
    t, v = made.columns
    rows, maker = (
        made.rows(style="e"),
        made.pick(["tek", "keysight", "rigol", "lecroy", "rs", "tek2"]),
    )
    if maker == "tek":
        side = [
            ["Record Length", "2.5e3", ""],
            ["Sample Interval", "4e-6", ""],
            ["Vertical Units", "V", ""],
            ["Source", "CH1", ""],
        ]
        rows = [
            [*(side[i] if i < len(side) else ["", "", ""]), *row, ""] for i, row in enumerate(rows)
        ]
        return "T0000.CSV", joined(rows, ",").encode(), {"column 4": t, "column 5": v}
    if maker == "tek2":
        head = "Model,MSO44\nLabel,,\nHorizontal Units,s\nSample Interval,4e-6\n\nTIME,CH1\n"
        return "t.csv", (head + joined(rows, ",")).encode(), {"TIME": t, "CH1": v}
    if maker == "keysight":
        head = "x-axis,1\nsecond,Volt\n"
        return "s.csv", (head + joined(rows, ",")).encode(), {"x-axis [second]": t, "1 [Volt]": v}
    if maker == "rigol":
        rows = [[str(i), row[1], "", ""] for i, row in enumerate(rows)]
        head = f"X,CH1,Start,Increment\nSequence,VOLT,0.000000e+00,{t[1]:.6e}\n"
        return "r.csv", (head + joined(rows, ",")).encode(), {"time [s]": t, "CH1 [VOLT]": v}
    if maker == "lecroy":
        head = "LECROYWR64Xi,32344,Waveform\nSegments,1,SegmentSize,30\n"
        head += "Segment,TrigTime,TimeSinceSegment1\n"
        head += "#1,10-Mar-2010 12:34:56,0\nTime,Ampl\n"
        return "C1.csv", (head + joined(rows, ",")).encode(), {"Time": t, "Ampl": v}
    return (
        "rs.csv",
        ("in s,C1 in V\n" + joined(rows, ",")).encode(),
        {"column 1 [s]": t, "C1 [V]": v},
    )


FAMILIES = {
    f.__name__: f
    for f in (
        encodings,
        delimiters,
        decimals,
        unit_rows,
        header_units,
        metadata,
        lvm,
        comsol,
        origin,
        bluehill,
        digitiser,
        spreadsheet,
        mat,
        clocks,
        overloads,
        minuses,
        trailing,
        oscilloscopes,
    )
}

"""`dealib bias`: forces of film and bias over displacement, their equilibria and the stroke."""

from __future__ import annotations

from pathlib import Path

import typer

from dealib.config.case import Case
from dealib.results.bias import BiasChart
from dealib.tasks.solving import bias


def draw_chart(
    case: Case,
    voltage: str | None,
    reach: tuple[str, ...] | None,
    out: Path | None,
    dark: bool,
    overwrite: bool,
) -> None:
    """Compute and draw the chart, write its CSV files, print its equilibria.

    Raises:
        ConfigError: If an option is wrong, a file exists already, or there is no bias.
    """
    from dealib.plots import style

    picture = out or Path(f"{case.config.name}-bias.png")
    tables = [picture.with_suffix(".csv"), picture.with_name(f"{picture.stem}-equilibria.csv")]
    style.check_target(picture, style.FORMATS, overwrite)
    for table in tables:
        style.check_target(table, (".csv",), overwrite)
    found = bias(case, voltage, reach)
    found.write(*tables)
    from dealib.plots.bias import draw_bias

    with style.theme(dark) as look:
        style.save(draw_bias(found, look, whole=reach is not None), picture)
    typer.echo("\n".join([*describe(found), *map(str, (picture, *tables))]))


def describe(chart: BiasChart) -> list[str]:
    """One line for each equilibrium, stroke and note."""
    lines = []
    for volts, equilibria in chart.equilibria.items():
        for e in equilibria:
            kind = "stable" if e.stable else "unstable"
            lines.append(
                f"{volts:6.4g} kV  {e.displacement:10.6f} mm  {e.force:10.6f} N  {kind:<8}"
                f"  net stiffness {e.stiffness:.4g} N/mm"
            )
    for stroke in chart.strokes():
        back = (
            ""
            if stroke.returns
            else f"; without voltage it remains at {stroke.back.displacement:.6f} mm"
        )
        lines.append(
            f"stroke {stroke.length:.6f} mm, from {stroke.start.displacement:.6f} mm "
            f"to {stroke.end.displacement:.6f} mm{back}"
        )
    return lines + [f"{note}; see --reach" for note in chart.notes()]

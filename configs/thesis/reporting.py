"""The report of the identification in Markdown; every number in it is computed."""

from __future__ import annotations

from devices import MASSES, Parameters
from fitting import Fit
from maps import PRESTRETCHES, Maps, missed
from windows import WINDOWS, Window

INTRODUCTION = """\
Written by `python configs/thesis/identify.py`; every number below is computed. The thesis
publishes none of these parameters. They are identified from all windows that its text and axes
give (`windows.py`), by one least squares over soft intervals. The physics that the thesis states
(constraints, bold figures below) counts a thousand times, other printed bounds ten times, inferred
bounds once. Uncertainty takes half a window's width as one standard deviation of each quantity."""

CLOSE = """\
"Close" is within 10 %. The thesis says that neo-Hookean 1 MPa and Mooney-Rivlin 1.25 MPa both fit
one measurement, while the other moduli are too soft or too stiff (section 4.2.3). From 1.25 MPa
the Mooney-Rivlin curves of 1 and 1.5 MPa are 20 % away, since the force of a film alone is in
proportion to its modulus; a curve that fits what 1.25 MPa fits lies within half of that step."""

COUPLING = """\
The thesis names two couplings, Maxwell's stress and Pelrine's pressure eps (V/d)^2 (section
3.2.3), but neither says which one a figure uses nor which thickness d is. Figs. 31 and 32 are
computed by dealib's `energy` (with which `maxwell_traction` and `pelrine` with the current
thickness agree) and by `pelrine_undeformed`, the pressure with the thickness at rest. One set of
parameters serves both."""

FALLING = """\
A flat film resists the mount only by its pre-stress (electrodes carry none): F = k u with k in
proportion to sigma - eps (V/H)^2. If the voltage takes nearly all of the pre-stress, a small mass
finds no resistance and sinks until stretching stops it, while a large mass is already carried by
stretching: the stroke falls with the mass. If much pre-stress is left, the stroke begins at zero,
in proportion to the mass, and rises. So the trend wants a large ratio of Maxwell stress to
pre-stress, that is little pre-stretch or a thin film. At large masses the energy form adds a rise:
as the film thins the true field grows, and Mooney-Rivlin with C01 < 0 softens. With the thickness
at rest in the pressure that growth is missing, and the strokes keep falling."""

RECIPROCAL = """\
With any coupling derived from a potential, the force that a voltage takes off and the growth of
the capacitance are one quantity: F(u, 0) - F(u, V) = integral of V dC/du, to leading order V^2/2
dC/du. The axis of Figs. 33 and 38 has DEAP100 begin at 220 .. 240 pF and end, at 2.5 mm, at 320 ..
340 pF (its first and last ticks): at least {rise:.0f} pF more. C grows with u^2, so that dC/du at
2 mm is at least {slope:.1f} pF/mm and the blocking force {force:.3f} N, beyond the axis of Fig. 32
(0.14 N), whatever the radii, film, pre-stretch and law. Hence the capacitance at 2.5 mm stays
below its inferred window. A pressure with the thickness at rest obeys no such relation and takes
off less."""

LONGER = """\
Fig. 37's stress is said to increase with the diameter at the same displacement. With one
pre-stretch it cannot from DEAP100 to DEAP200: the stress in the middle of the film is that of the
pre-stretch plus that of the strip's elongation, (u/L)^2/2, and Figs. 38 and 39 make DEAP200's
strip about twice as long. Computed ratio {ratio:.3f}. It would take a pre-stretch of {stretch:.3f}
in DEAP200 against {own:.3f} in DEAP100 to have the same {stress:.3f} MPa; the text gives all
devices the same film, so that this is not used."""

FOUND = """\
What gives the published trend is the coupling together with little pre-stress. With the thickness
at rest in Pelrine's pressure the strokes of both laws fall up to a pre-stretch of 1.14, at 1.17 no
longer. With the other parameters identified anew every constraint of the thesis is met at 1.14 and
only there: below, Mooney-Rivlin 1.25 MPa and neo-Hookean 1 MPa part in Fig. 19 (in a thin
incompressible film their ratio is 1.875 - 0.625 x pre-stretch^2, at most 1.1 from 1.114 on) and
the electrodes carry more stress than the film (Fig. 26); above, the strokes rise and the film
carries too little of the force for Fig. 20. With the energy form no pre-stretch meets Figs. 19, 26
and 31 together: of those tried, Mooney-Rivlin strokes fall at 1.08 only. On the identified device
the neo-Hookean ones fall to 25 g and are flat from there: the one constraint that is missed, by
0.1 %."""


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(r) + " |" for r in [head, ["---"] * len(head), *rows]]
    return "\n".join(lines)


def report(final: Fit, fits: dict[str, Fit], maps: Maps) -> str:
    """The whole report."""
    names, p = Parameters.names(), final.parameters
    spread = dict(zip(names, final.uncertainties, strict=True))
    values = [[n, f"{getattr(p, n):.4g}", f"{spread[n]:.2g}", unit(n)] for n in names]
    hard = [w for w in final.windows if w.hard]
    met = [w for w in hard if not (w.printed(v := final.values[w.quantity]) and w.misfit(v))]
    rise = 80.0  # pF, of Fig. 38: 320 - 240
    slope = 2 * 2.0 / 2.5**2 * rise
    stretch, stress = maps.prestretch_200
    out = [
        "# Identified parameters",
        INTRODUCTION,
        "## Values (finite elements)",
        table(["parameter", "value", "uncertainty", "unit"], values),
        f"Weighted misfit (sum of squares, in widths) {final.misfit():.3g}; {len(final.held())} of "
        f"{len(final.windows)} windows hold, {len(met)} of {len(hard)} constraints.",
        COUPLING,
        "## Windows",
        window_table(final),
        CLOSE,
        "## Windows that contradict each other",
        "Each violated window, by how much of its width, and the violated window whose pull on the "
        "parameters is most opposed to it (cosine -1: they ask for exactly opposite changes).",
        table(
            ["window", "off by (widths)", "against", "cosine"],
            [
                [named(a), f"{a.misfit(final.values[a.quantity]):+.2f}", named(b), f"{c:.2f}"]
                for a, b, c in final.opposed()
            ],
        ),
        "### Fig. 32 against Figs. 33 and 38",
        RECIPROCAL.format(rise=rise, slope=slope, force=2.5**2 / 2 * slope * 1e-3),
        table(*maps.blocking),
        "The blocking force lies between the two estimates of the energy form; that of "
        "`pelrine_undeformed` lies below both.",
        "### Fig. 37",
        LONGER.format(
            ratio=final.values["S_200_100"], stretch=stretch, own=p.prestretch, stress=stress
        ),
        "## What changes if figures are left out (membrane model)",
        table(
            [
                "fit",
                "weighted misfit",
                "held",
                "constraints missed",
                "film (um)",
                "pre-stretch",
                "eps_r",
            ],
            [variant(name, f) for name, f in fits.items()],
        ),
        "## Fig. 31: why the stroke falls with the mass",
        FALLING,
        FOUND,
        "### By coupling, on the identified device (finite elements)",
        f"Strokes at {', '.join(f'{m:g}' for m in MASSES)} g here and below.",
        table(*maps.by_coupling),
        "### Pre-stretch x coupling x law, all else as identified (membrane model)",
        table(*maps.by_prestretch),
        "### Pre-stretch x coupling, all else identified anew (membrane model)",
        f"Pre-stretch held at {PRESTRETCHES[0]:g} .. {PRESTRETCHES[-1]:g}, the other "
        f"{len(names) - 1} parameters free, Fig. 31 demanded of both laws by one coupling.",
        table(*maps.refitted),
    ]
    return "\n\n".join(out) + "\n"


def unit(name: str) -> str:
    """Of a parameter."""
    if name.startswith("preload"):
        return "N"
    return "" if name in ("prestretch", "permittivity") else "mm"


def named(w: Window) -> str:
    """A window in a word."""
    return f"Fig. {w.figure} {w.quantity}" if w.figure[0].isdigit() else w.quantity


def window_table(f: Fit) -> str:
    """Every window with its computed value."""
    rows = []
    for w in WINDOWS:
        value = f.values[w.quantity]
        off = w.misfit(value)
        holds = ("holds" if off == 0 else f"**{off:+.2f}**") + ("" if w.fitted else " (not fitted)")
        span = f"{w.low:.4g} .. {w.high:.4g}"
        figure = f"**{w.figure}**" if w.hard else w.figure
        rows.append([figure, w.quantity, span, f"{value:.4g}", w.unit, w.kind, holds, w.note])
    return table(
        ["figure", "quantity", "window", "computed", "unit", "from", "misfit (widths)", "meaning"],
        rows,
    )


def variant(name: str, f: Fit) -> list[str]:
    """A row about one fit."""
    p = f.parameters
    return [name, f"{f.misfit():.3g}", f"{len(f.held())} of {len(f.windows)}", missed(f),
            f"{1e3 * p.film_thickness:.1f}", f"{p.prestretch:.3f}",
            f"{p.permittivity:.2f}"]  # fmt: skip

"""What the thesis publishes as numbers, each as an interval of a computed quantity.

An interval comes from the text or from an axis. `axis`: the curve lies on it. `fill`: an axis is
not drawn a whole tick longer than its data, so the curve's extreme lies in the axis's last tick
(last two where it shares the axes with an experiment, whose curve may be the longer one).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

HARD = 1000.0  # weight of a miss of a constraint
PRINTED = 10.0  # weight of a miss of a bound that is printed: no curve leaves its axes


@dataclass(frozen=True)
class Window:
    """An interval of a quantity.

    Attributes:
        figure: Where it is published.
        quantity: Name among the computed quantities.
        low, high: Interval.
        unit: Of both.
        kind: How it follows from the thesis; `prior` is not in the thesis.
        note: What is meant.
        fitted: Whether it takes part in the fit, or is only reported.
        lowest: Of a `fill`: the axis's lower end is printed, the upper bound inferred.
        hard: Whether its printed bounds are constraints: the physics that must hold.
    """

    figure: str
    quantity: str
    low: float
    high: float
    unit: str
    kind: Literal["text", "axis", "fill", "prior"]
    note: str
    fitted: bool = True
    lowest: bool = False
    hard: bool = False

    @property
    def weights(self) -> tuple[float, float]:
        """Of a miss below and above: a printed bound is nearly hard."""
        if self.kind == "prior":
            return 1.0, 1.0
        printed = HARD if self.hard else PRINTED
        if self.kind != "fill":
            return printed, printed
        return (printed, 1.0) if self.lowest else (1.0, printed)

    @property
    def scale(self) -> float:
        """The interval's width, at least 3 % of its middle (the reading of an axis)."""
        return max(self.high - self.low, 0.03 * abs(self.high + self.low) / 2)

    def misfit(self, value: float) -> float:
        """Zero inside, the distance over the scale outside; signed."""
        return (max(value - self.high, 0.0) - max(self.low - value, 0.0)) / self.scale

    def printed(self, value: float) -> bool:
        """Whether the bound next to a value is printed, not inferred."""
        return self.weights[value > (self.low + self.high) / 2] >= PRINTED

    def offset(self, value: float) -> float:
        """Distance from the middle over the scale."""
        return (value - (self.low + self.high) / 2) / self.scale


W = Window
H = partial(Window, hard=True)
WINDOWS = (
    # the device
    W("ch. 3", "outer_75", 0.75 * 9.525, 9.525, "mm", "text", "0.75 inch across, frame included"),
    W("ch. 3", "outer_100", 0.75 * 12.7, 12.7, "mm", "text", "1 inch across, frame included"),
    W("ch. 3", "outer_200", 0.75 * 25.4, 25.4, "mm", "text", "2 inch across, frame included"),
    W("ch. 3", "film_um", 20, 60, "um", "text", "'a few 10s of um'"),
    W("-", "permittivity", 2.5, 3.5, "", "prior", "silicone; the thesis gives no value"),
    W("29", "length_100", 3.5, 4.5, "mm", "fill", "electrode length axis"),
    W("39", "length_200", 7.5, 9.5, "mm", "fill", "electrode length axis, tick 2 mm"),
    W("12", "preload12_u", 1.245, 1.25, "mm", "fill", "the converged displacement"),
    # film alone
    W("19", "film_nh1_F3", 0.3, 0.6, "N", "axis", "NH 1 MPa at 3 mm: below the stiffest curve"),
    W("19", "film_nh15_F3", 0.5, 0.6, "N", "fill", "NH 1.5 MPa at 3 mm: the stiffest curve"),
    W("19", "film_mr15_F3", 0.4, 0.6, "N", "fill", "MR 1.5 MPa at 3 mm"),
    H("19", "film_ratio_1", 0.9, 1.1, "", "text", "MR 1.25 over NH 1 MPa: both fit one experiment"),
    H("19", "film_ratio_2", 0.9, 1.1, "", "text", "the same at 2 mm"),
    H("19", "film_ratio_3", 0.9, 1.1, "", "text", "the same at 3 mm"),
    # with electrodes
    W("20", "nh_F3", 0.6, 0.8, "N", "fill", "NH 3 MPa at 3 mm: mid-loop"),
    W("20", "mr_F3", 0.6, 0.8, "N", "fill", "MR 2 MPa at 3 mm: mid-loop"),
    H("20", "ratio_2", 0.9, 1.1, "", "text", "MR 2 over NH 3 MPa at 2 mm: middle of one loop"),
    W("20", "ratio_3", 0.9, 1.1, "", "text", "the same at 3 mm"),
    W("24", "nh_F2", 0.35, 0.40, "N", "fill", "simulated force at 2 mm"),
    H("26", "stress_ratio", 0.0, 1.0, "", "text", "S_rr of the electrodes over the film's, 2 mm"),
    H("36", "preload36_u10", 0.75, 0.76, "mm", "fill", "pre-deflection, electrodes 10 um"),
    H("36", "preload36_u20", 0.68, 0.69, "mm", "fill", "the same, 20 um", lowest=True),
    W("34", "nh75_F3", 0.3, 0.4, "N", "fill", "DEAP75 at 3 mm"),
    W("34", "ratio_75_2", 0.9, 1.1, "", "text", "MR over NH at 2 mm, 'very similar'"),
    W("34", "ratio_75_3", 0.9, 1.1, "", "text", "the same at 3 mm"),
    # electromechanics
    W("23", "preload23_N", 0.35, 0.40, "N", "fill", "the force's maximum"),
    W("23", "preload23_u", 3.0, 3.5, "mm", "fill", "displacement at that force and 2.5 kV"),
    H("28", "field", 31.6, 316, "V/um", "text", "'of the order of 10^8 V/m'"),
    H("29", "charge_100", 0.002, 0.003, "C/m2", "text", "plateau at 2.5 kV, 2 mm"),
    H("39", "charge_75", 0.0024, 0.003, "C/m2", "fill", "the lower axis ends at 0.0024"),
    H("39", "charge_200", 0.0024, 0.003, "C/m2", "fill", "the lower axis ends at 0.0024"),
    H("39", "charge_spread", 0.0, 0.1, "", "text", "the same for the three devices"),
    *(
        one
        for law, by, grade in (
            ("nh", "_undeformed", H),
            ("mr", "_undeformed", H),
            ("nh", "", H),
            ("mr", "", partial(W, fitted=False)),
        )
        for one in (
            grade("31", f"{law}_stroke_5{by}", 0.4, 0.6, "mm", "fill", "at 5 g, the largest"),
            *(
                grade("31", f"{law}_stroke_{a}_{b}{by}", 0.0, 1.0, "", "text", f"{a} over {b} g")
                for a, b in ((10, 5), (15, 10), (20, 15), (25, 20), (28, 25))
            ),
        )
    ),
    *(
        H("32", f"{law}_blocking{by}", 0.10, 0.14, "N", "axis", "force change at 2 mm, 2.5 kV")
        for law in ("nh", "mr")
        for by in ("", "_undeformed")
    ),
    W("35", "nh75_blocking_35", 0.04, 0.06, "N", "fill", "DEAP75, 2.5 kV; at displacement_35"),
    W("35", "nh75_blocking", 0.04, 0.06, "N", "fill", "the same if it were at 2 mm", False),
    # capacitance
    H("38", "C100_0", 220, 240, "pF", "fill", "DEAP100 at rest", lowest=True),
    H("38", "C100_25", 320, 340, "pF", "fill", "DEAP100 at 2.5 mm"),
    H("38", "C75_0", 150, 160, "pF", "fill", "DEAP75 at rest", lowest=True),
    H("38", "C75_25", 220, 230, "pF", "fill", "DEAP75 at 2.5 mm"),
    H("38", "C200_0", 980, 990, "pF", "fill", "DEAP200 at rest", lowest=True),
    H("38", "C200_25", 1050, 1060, "pF", "fill", "DEAP200 at 2.5 mm"),
    # a trend that no geometry of longer strips can give
    W("37", "S_100_75", 1.0, 3.0, "", "text", "S_rr mid-film at 2 mm, DEAP100 / DEAP75", False),
    W("37", "S_200_100", 1.0, 3.0, "", "text", "S_rr mid-film at 2 mm, DEAP200 / DEAP100", False),
)

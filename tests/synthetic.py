"""Makes the synthetic data of configs/fits: `python tests/synthetic.py`."""

from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

import dealib
from dealib.calibration.schema import FitPlan

FITS = Path(__file__).parent.parent / "configs" / "fits"
TRUE = {
    "materials.film.youngs_modulus": 1.0,  # MPa
    "materials.film.prestretch": 1.15,
    "materials.film.relative_permittivity": 3.0,
}
NOISE, SEED = 2e-3, 2011  # N
LABEL = """\
# SYNTHETIC data, no measurement: computed by dealib for configs/fits/example.yaml, in 60 steps a
# stage, with youngs_modulus 1 MPa, prestretch 1.15, relative_permittivity 3.0 of the film,
# plus normal noise of standard deviation 2 mN on the force (seed 2011).
"""


def texts():
    """Content of both files by name."""
    case = FitPlan(FITS / "example.yaml").case(0, TRUE)
    fine = [f"program.{k}.steps=60" for k in (1, 3)]  # so that the fit's own steps are a test
    h = [state.row for state in dealib.Simulation(dealib.load(case.path, [*case.overrides, *fine]))]
    u, F, V = (
        np.array([row[k] for row in h]) for k in ("displacement_mm", "force_N", "voltage_kV")
    )
    stage = np.array([row["stage"] for row in h])
    random = np.random.default_rng(SEED)
    push = np.flatnonzero((stage == "prestrain") | (stage == "preload"))
    x = np.linspace(-0.1, -2.0, 20)
    force = np.interp(-x, -u[push], F[push]) + random.normal(0, NOISE, len(x))
    first = "displacement [mm],force [N]\n"
    first += "".join(f"{a:.3f},{b:.5f}\n" for a, b in zip(x, force, strict=True))
    cycle = np.flatnonzero((stage == "actuate") | (stage == "hold"))
    top = cycle[np.argmax(V[cycle])]
    rising, falling = cycle[cycle <= top], cycle[cycle >= top]
    v = np.concatenate([np.linspace(0, 2.4, 13), np.linspace(2.3, 0.1, 12)])
    force = np.where(
        np.arange(len(v)) < 13,
        np.interp(v, V[rising], F[rising]),
        np.interp(v, V[falling][::-1], F[falling][::-1]),
    )
    force += random.normal(0, NOISE, len(v))
    second = "Voltage [V];Load cell [mN]\n"
    second += "".join(f"{a:.0f};{b:.2f}\n" for a, b in zip(1e3 * v, 1e3 * force, strict=True))
    return {
        "synthetic_push.csv": LABEL + first,
        "synthetic_voltage.csv": LABEL + second,
        "synthetic_relaxation.csv": relaxation(),
        "synthetic_deap100.csv": deap100(),
    }


RELAXING = {  # MPa, s
    "materials.electrode.youngs_modulus": 2.0,
    "materials.electrode.branches.0.shear_modulus": 0.25,
    "materials.electrode.branches.0.relaxation_time": 0.4,
    "materials.electrode.branches.1.shear_modulus": 0.25,
    "materials.electrode.branches.1.relaxation_time": 8.0,
}
RELAXING_NOISE, RELAXING_SEED = 5e-4, 2012  # N
RELAXING_LABEL = """\
# SYNTHETIC data, no measurement: computed by dealib for configs/fits/relaxation.yaml with
# electrodes of youngs_modulus 2 MPa and branches of 250 kPa, 0.4 s and 250 kPa, 8 s,
# plus normal noise of standard deviation 0.5 mN on the force (seed 2012).
"""


def relaxation():
    """Content of the relaxation curve's file."""
    plan = FitPlan(FITS / "relaxation.yaml")
    units = {key: 1e3 if "shear" in key else 1.0 for key in RELAXING}  # kPa, MPa, s
    case = plan.case(0, {key: units[key] * value for key, value in RELAXING.items()})
    h = [state.row for state in dealib.Simulation(case)]
    t, F = (np.array([row[k] for row in h]) for k in ("time_s", "force_N"))
    x = np.concatenate([np.linspace(0.1, 1.1, 21), np.geomspace(1.3, 60, 30)])
    smooth = PchipInterpolator(t, F)(x)  # few steps: straight lines would add a misfit of their own
    force = smooth + np.random.default_rng(RELAXING_SEED).normal(0, RELAXING_NOISE, len(x))
    rows = "".join(f"{a:.4f},{b:.5f}\n" for a, b in zip(x, force, strict=True))
    return RELAXING_LABEL + "time [s],force [N]\n" + rows


MODULUS = 1.04  # MPa: what a film that differs a little from deap100.yaml's would show
DEAP100_LABEL = """\
# SYNTHETIC data, no measurement: computed by dealib for configs/deap100.yaml, without air and
# on a coarse mesh, with a film of youngs_modulus 1.04 MPa, plus normal noise of standard deviation
# 5 um and 0.5 pF (seed 2011).
"""


def deap100():
    """Content of the file that the guide compares a run with."""
    modulus = f"materials.film.youngs_modulus={MODULUS} MPa"
    quick = [modulus, "geometry.air_height=0 mm", "mesh.columns=30", "mesh.film_rows=2"]
    case = dealib.load(FITS.parent / "deap100.yaml", quick)
    h = [state.row for state in dealib.Simulation(case)]
    h = [row for row in h if row["stage"] in ("hold", "actuate")]
    V, u, C = (
        np.array([r[k] for r in h]) for k in ("voltage_kV", "displacement_mm", "capacitance_pF")
    )
    top, random = int(np.argmax(V)), np.random.default_rng(SEED)
    v = np.concatenate([np.linspace(0, 2.5, 26), np.linspace(2.4, 0, 25)])
    rising = np.arange(len(v)) < 26
    columns = [v]
    for values, noise in ((u, 5e-3), (C, 0.5)):
        up, down = (
            np.interp(v, V[: top + 1], values[: top + 1]),
            np.interp(v, V[top:][::-1], values[top:][::-1]),
        )
        columns.append(np.where(rising, up, down) + random.normal(0, noise, len(v)))
    rows = "".join(f"{1e3 * a:.0f},{b:.4f},{c:.2f}\n" for a, b, c in zip(*columns, strict=True))
    return DEAP100_LABEL + "voltage [V],displacement [mm],capacitance [pF]\n" + rows


if __name__ == "__main__":
    for name, text in texts().items():
        (FITS / name).write_text(text)

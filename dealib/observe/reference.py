"""The page of all columns: of the history, and of the tables that commands write beside runs."""

from __future__ import annotations

from collections.abc import Iterator

from dealib.device.records import KINDS
from dealib.observe.quantities import QUANTITIES

# what each quantity means, with its sign
MEANINGS = {
    "step": "number of the converged state; 0 is the state as mounted",
    "time_s": "time of the program; in a stage that follows a branch it counts the steps",
    "displacement_mm": "displacement of the mount, positive along its axis (in a laminate upwards)",
    "force_N": "force on the mount, positive along its axis; its work is force times displacement",
    "voltage_kV": "voltage of the terminal against ground",
    "charge_uC": "charge on the terminal, positive at a positive voltage",
    "capacitance_pF": "charge over voltage; at 0 V that of the deformed device at a small voltage; "
    "with several terminals the charge on the first one at unit voltage of the second one",
    "pressure_kPa": "pressure in the chamber, positive where it pushes the walls outwards",
    "volume_mm3": "volume by which the walls have enlarged the chamber",
    "rotation_deg": "component of the rigid mount's rotation vector, by the right-hand rule",
    "moment_Nmm": "moment on the mount about that axis, with the same sign",
    "elastic_energy_mJ": "stored in the material, with its branches; 0 where it is unstretched",
    "electric_energy_mJ": "stored in the field, the integral of eps/2 J e.e",
    "field_max_MV_per_m": "largest true field in the film",
    "thickness_stretch_min": "smallest thickness of the film over its unstretched thickness",
    "newton_iterations": "Newton iterations of the step",
    "stretch_max": "largest principal stretch of the film since its unstretched state",
    "tension_min_MPa": "smallest in-plane principal true stress with Maxwell's, averaged through "
    "the film's thickness; negative is compression",
    "breakdown_use": "largest true field over the breakdown strength; 1 is the limit",
    "failure_probability": "probability of breakdown, 1 - exp(-integral of (E/E0)^m dV/V0)",
    "wrinkling_use": "lost share of the tension of the mounted film; if that is below a thousandth "
    "of the shear modulus G, compression over G/1000; 1 is the limit",
    "pull_in_use": "true field over the field at which the film is unstable under dead loads; 1 is "
    "the limit, inf where it is unstable without a field",
    "stability_use": "lost share of the law's stiffness at rest; 1 is the limit",
    "stretch_use": "largest stretch over limits.stretch_max; 1 is the limit",
    "locking_use": "used share of the law's extensibility; 1 is where it locks",
    "differential_capacitance_pF": "dQ/dV with the other ports driven as they are",
    "blocked_capacitance_pF": "dQ/dV with all other ports held",
    "mount_stiffness_N_per_mm": "dF/du with all other ports held",
    "electrode_resistance_kohm": "from one end of an electrode to its other end",
    "rc_time_us": "time in which the electrodes charge through their resistance",
    "dissipated_energy_mJ": "lost in branches and by softening since the start",
    "dissipated_power_mW": "at which branches dissipate in this state",
    "electrode_loss_mJ": "lost in the resistance of the electrodes since the start",
    "kinetic_energy_mJ": "of the body and of what hangs on its mounts",
    "damped_energy_mJ": "lost to Rayleigh damping since the start",
    "numerical_dissipation_mJ": "lost to the time integration, and where motion is ended",
    "velocity_mm_per_s": "of the mount, positive along its axis",
    "angular_velocity_deg_per_s": "of the rigid mount, with the sign of its rotation",
    "mount_work_mJ": "work done on the device by the force on the mount since the start",
    "terminal_work_mJ": "work done on the device by the source: integral of V dQ",
    "chamber_work_mJ": "work done on the device by the pressure: integral of p dV",
    "turn_work_mJ": "work done on the device by the moment",
    "wrinkled_area_mm2": "area of the mounted film that is wrinkled",
    "energy_residual_mJ": "stored, less its value at step 0, plus lost energy, less all works: the "
    "error of the trapezoidal rule between the steps",
    "softest_mode_N_per_mm": "lowest eigenvalue of the tangent, for a mode of 1 mm root mean "
    "square; negative is unstable",
    "unstable_modes": "number of negative eigenvalues, with the ports held as the stage says",
    "limit_point": "1 where the varied quantity turns back, otherwise 0",
    "bifurcation": "1 where another branch of equilibria begins, otherwise 0",
    "solved": "1 where the state was solved, 0 where the row is interpolated between solved states",
}
# file, columns, unit and meaning; a name in capitals stands for names of ports and probes
_TABLES = (
    ("modes.csv", "stage, step", "", "state at whose end modes are found"),
    ("", "mode", "", "1 is the lowest"),
    ("", "frequency_Hz", "Hz", "natural frequency; of a mode that grows minus its rate over 2 pi"),
    ("", "modal_mass_g", "g", "for a largest displacement of 1 mm"),
    ("", "displacement_mm_per_mm, force_N_per_mm", "", "of each port, for the same displacement"),
    ("", "open_circuit_Hz, short_circuit_Hz", "Hz", "with the terminal open, and held"),
    ("", "coupling_squared", "", "(open^2 - short^2) / open^2 of these frequencies"),
    ("frequencies.csv", "stage, step, time_s", "", "each state of the stage `--along`"),
    ("", "displacement_mm, force_N", "", "of each port, as in the history"),
    ("", "frequency_Hz.1", "Hz", "of the first mode, followed by its shape; then of the others"),
    ("response.csv", "frequency_Hz", "Hz", "of a small voltage of the source"),
    ("", "displacement_mm_per_kV, phase_deg", "mm/kV, deg", "of a free mount, and its phase"),
    ("", "force_N_per_kV, force_phase_deg", "N/kV, deg", "of a held mount, and its phase"),
    ("", "NAME_mm_per_kV, NAME_phase_deg", "mm/kV, deg", "of a probe of a displacement"),
    ("", "charge_uC_per_kV, charge_phase_deg", "uC/kV, deg", "on the terminal"),
    ("", "current_uA_per_kV, current_phase_deg", "uA/kV, deg", "into the terminal"),
    ("", "impedance_Mohm, impedance_phase_deg", "Mohm, deg", "of device and driver in series"),
    ("", "parallel_capacitance_pF, loss_tangent", "pF", "of a lossy capacitor instead of it"),
    ("", "sound_pressure_Pa_per_kV, sound_phase_deg", "Pa/kV, deg", "with `--sound-at`"),
    ("", "sound_power_mW_per_kV2", "mW/kV2", "radiated, likewise"),
    ("circuit.csv", "part, value, low, high, unit", "", "equivalent circuit, 95 % intervals"),
    ("sensitivity.csv", "quantity", "", "what is differentiated"),
    ("", "key, value, unit", "", "number of the config by which"),
    ("", "derivative", "", "d quantity / d key, in the units of both"),
    ("", "logarithmic", "", "d ln quantity / d ln key"),
    ("summary.csv", "mean, deviation", "", "of a quantity that scatters"),
    ("", "mean_error", "", "half of the 95 % interval; likewise of every number there"),
    ("sobol.csv", "first, total", "", "Sobol indices of a key"),
    ("tables.csv", "displacement_mm, voltage_kV", "", "node of the grid, of the ports it is over"),
    ("", "force_N, charge_uC, capacitance_pF", "", "there, as in the history"),
    ("", "potential_mJ", "mJ", "elastic less electric energy"),
)
_HEAD = """# All columns

This page is for everyone who reads `history.csv` or another table and wants to know what a column
is. It is made by `dealib schema --of history --reference` from the records that the program
writes by.

The name of a column ends in its unit. Where a device has several ports of a kind, the name of the
port follows: `voltage_kV.left`, and `capacitance_pF.left.right` for pairs.

## History

| column | meaning | unit | there with |
|---|---|---|---|
| `stage` | name of the stage that the state belongs to |  |  |"""
_FURTHER = (
    ("inflow_mm3.NAME", "mm3", "volume that came into a chamber through an opening", "an opening"),
    ("NAME_UNIT", "", "a probe, such as `tip_mm` or `E_MV_per_m`; an integral: no unit", "probes"),
)
_OTHERS = """
## Tables of other commands

`dealib.open(RUN).table("modes")` reads `modes.csv` of a run directory as a pandas table. Here too
the name of a port follows where there are several of its kind.

| file | columns | meaning | unit |
|---|---|---|---|"""


def page() -> str:
    """The page, in Markdown."""
    return "\n".join([_HEAD, *_history(), *_ports(), _OTHERS, *_tables()]) + "\n"


def _history() -> Iterator[str]:
    for q in QUANTITIES:
        needs = "; ".join(filter(None, (f"a {q.kind.name}" if q.kind else "", q.needs.text)))
        yield f"| `{q.name}` | {MEANINGS[q.name]} | {q.unit} | {needs} |"
    for name, unit, meaning, needs in _FURTHER:
        yield f"| `{name}` | {meaning} | {unit} | {needs} |"


def _ports() -> Iterator[str]:
    yield "\nA port has a value and its dual. Work is one times the change of the other:\n"
    for kind in KINDS.values():
        yield f"- {kind.name}: {kind.primal.name} ({kind.primal.unit}) and {kind.dual.name} " + (
            f"({kind.dual.unit})"
        )


def _tables() -> Iterator[str]:
    for file, names, unit, meaning in _TABLES:
        columns = ", ".join(f"`{name}`" for name in names.split(", "))
        yield f"| {f'`{file}`' if file else ''} | {columns} | {meaning} | {unit} |"

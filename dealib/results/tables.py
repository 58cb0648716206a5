"""Tables of a device for system simulation: F(u, V), Q(u, V), C(u, V), with their interpolant.

The interpolant is that of one potential, so that force and charge come from the same energy:
F = dPi/du, Q = -dPi/dV, and dF/dV = -dQ/du holds everywhere, not only at the nodes. Pi is the
piecewise bicubic function that has Pi, F and -Q of the solved states at the nodes; between them
the error of F and Q falls with the third power of the spacing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dealib.errors import ConfigError
from dealib.files import whole, write_text
from dealib.results.hdf5 import new_hdf5

if TYPE_CHECKING:
    from dealib.results.reader import Run

Array = npt.NDArray[np.float64]
NAME = "tables"
AXES = ("displacement_mm", "voltage_kV")
COLUMNS = ("force_N", "charge_uC", "capacitance_pF", "potential_mJ")


@dataclass(frozen=True)
class Tables:
    """A device as two ports, on a grid of displacements and voltages.

    Attributes:
        displacement_mm: Grid, ascending, (n,).
        voltage_kV: Grid, ascending, (m,).
        force_N: On the mount, (n, m).
        charge_uC: On the terminal, (n, m).
        capacitance_pF: Charge over voltage; at 0 V by a small test voltage, (n, m).
        potential_mJ: Elastic minus electric energy, Pi, (n, m).
    """

    displacement_mm: Array
    voltage_kV: Array
    force_N: Array
    charge_uC: Array
    capacitance_pF: Array
    potential_mJ: Array
    _mixed: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        from scipy.interpolate import CubicSpline

        by_force = CubicSpline(self.voltage_kV, self.force_N, axis=1)(self.voltage_kV, 1)
        by_charge = CubicSpline(self.displacement_mm, self.charge_uC)(self.displacement_mm, 1)
        object.__setattr__(self, "_mixed", (by_force - by_charge) / 2)  # d2 Pi / du dV

    # --- the interpolant -------------------------------------------------------------------------

    def potential(self, displacement: Any, voltage: Any) -> Array:
        """Pi, mJ, at displacements (mm) and voltages (kV) that broadcast."""
        return self._derivative(displacement, voltage, 0, 0)

    def force(self, displacement: Any, voltage: Any) -> Array:
        """Force on the mount, N."""
        return self._derivative(displacement, voltage, 1, 0)

    def charge(self, displacement: Any, voltage: Any) -> Array:
        """Charge on the terminal, uC."""
        return -self._derivative(displacement, voltage, 0, 1)

    def stiffness(self, displacement: Any, voltage: Any) -> Array:
        """DF/du at constant voltage, N/mm."""
        return self._derivative(displacement, voltage, 2, 0)

    def coupling(self, displacement: Any, voltage: Any) -> Array:
        """DF/dV at constant displacement, which is -dQ/du at constant voltage, N/kV."""
        return self._derivative(displacement, voltage, 1, 1)

    def capacitance(self, displacement: Any, voltage: Any = 0.0) -> Array:
        """Differential capacitance dQ/dV at constant displacement, pF."""
        return -1e3 * self._derivative(displacement, voltage, 0, 2)

    def _derivative(self, displacement: Any, voltage: Any, nu: int, nv: int) -> Array:
        u, v = np.broadcast_arrays(np.asarray(displacement, float), np.asarray(voltage, float))
        i, left = _basis(self.displacement_mm, u, nu, "displacement", "mm")
        j, right = _basis(self.voltage_kV, v, nv, "voltage", "kV")
        total = np.zeros(u.shape)
        for a in (0, 1):
            for b in (0, 1):
                at = (i + a, j + b)
                total += left[0][a] * right[0][b] * self.potential_mJ[at]
                total += left[1][a] * right[0][b] * self.force_N[at]
                total -= left[0][a] * right[1][b] * self.charge_uC[at]
                total += left[1][a] * right[1][b] * self._mixed[at]
        return total

    # --- files -----------------------------------------------------------------------------------

    def plain(self) -> dict[str, Array]:
        """All arrays by name."""
        return {name: getattr(self, name) for name in (*AXES, *COLUMNS)}

    def save(self, folder: Path) -> list[Path]:
        """Write tables.csv (one row a node), tables.h5 and tables.mat; returns their paths.

        Raises:
            PlatformError: If the disk refuses.
        """
        from scipy.io import savemat

        paths = [folder / f"{NAME}.{ending}" for ending in ("csv", "h5", "mat")]
        u, v = np.meshgrid(self.displacement_mm, self.voltage_kV, indexing="ij")
        rows = np.stack([u, v, *(getattr(self, c) for c in COLUMNS)], axis=-1).reshape(-1, 6)
        lines = [",".join((*AXES, *COLUMNS)), *(",".join(map(repr, r)) for r in rows.tolist())]
        write_text(paths[0], "\n".join(lines) + "\n")
        with new_hdf5(paths[1]) as file:
            for name, values in self.plain().items():
                file[name] = values
        with whole(paths[2]) as temporary:
            savemat(str(temporary), self.plain(), oned_as="row")
        return paths


def _basis(grid: Array, x: Array, order: int, name: str, unit: str) -> tuple[Any, Any]:
    """Cell of each point, and derivatives of the cubic Hermite functions there.

    Returns:
        The index of the node below, and (values, slopes): for each the functions that belong to
        the node below and to the one above.

    Raises:
        ValueError: Outside the grid, where the tables know nothing.
    """
    slack = 1e-12 * (grid[-1] - grid[0])
    if (x < grid[0] - slack).any() or (x > grid[-1] + slack).any() or np.isnan(x).any():
        raise ValueError(f"the tables hold for a {name} of {grid[0]:g} .. {grid[-1]:g} {unit} only")
    k = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, len(grid) - 2)
    h = grid[k + 1] - grid[k]
    t = (x - grid[k]) / h
    cubics = ((1, 0, -3, 2), (0, 0, 3, -2)), ((0, 1, -2, 1), (0, 0, -1, 1))
    values, slopes = (
        [np.polynomial.Polynomial(c).deriv(order)(t) / h**order for c in pair] for pair in cubics
    )
    return k, (values, [s * h for s in slopes])


def collect(run: Run) -> Tables:
    """The tables of a run that has walked over the grid of its config's `tables`.

    Raises:
        ConfigError: If the run has no such grid, or has not met all of its nodes.
    """
    wanted = run.config.tables
    if wanted is None:
        raise ConfigError(f"{run.directory}: its config has no tables; see dealib export")
    h = run.history
    potential = h["elastic_energy_mJ"] - h["electric_energy_mJ"]
    values = np.column_stack([h[c] for c in COLUMNS[:-1]] + [potential])
    u, v = (np.sort(axis) for axis in wanted.grid)
    at = h[list(AXES)].to_numpy()
    found = np.full((len(u), len(v), 4), np.nan)
    for i, j in np.ndindex(len(u), len(v)):
        off = np.hypot((at[:, 0] - u[i]) / np.ptp(u), (at[:, 1] - v[j]) / np.ptp(v))
        if off.min() < 1e-9:
            found[i, j] = values[int(off.argmin())]
    if np.isnan(found).any():
        missing = int(np.isnan(found[..., 0]).sum())
        raise ConfigError(f"{run.directory}: {missing} of {len(u) * len(v)} nodes are not solved")
    return Tables(u, v, *np.moveaxis(found, -1, 0))


def load(path: str | Path) -> Tables:
    """Tables from their folder, or from one of their files (.csv, .h5, .mat).

    Raises:
        ConfigError: If there are none.
    """
    path = Path(path)
    file = path / f"{NAME}.h5" if path.is_dir() else path
    if not file.is_file():
        raise ConfigError(f"{path}: no tables here; dealib export CONFIG makes them")
    try:
        return Tables(**_read(file))
    except Exception as error:  # the readers raise theirs as they come
        raise ConfigError(f"{file}: no tables of dealib ({error})") from None


def _read(file: Path) -> dict[str, Array]:
    names = (*AXES, *COLUMNS)
    if file.suffix == ".h5":
        import h5py

        with h5py.File(file, "r") as content:
            return {name: np.asarray(content[name][:]) for name in names}
    if file.suffix == ".mat":
        from scipy.io import loadmat

        found = loadmat(str(file))
        return {name: found[name].ravel() if name in AXES else found[name] for name in names}
    rows: Any = np.sort(np.genfromtxt(file, delimiter=",", names=True), order=AXES)
    u, v = (np.unique(rows[axis]) for axis in AXES)
    shape = (len(u), len(v))
    return dict(zip(AXES, (u, v), strict=True)) | {c: rows[c].reshape(shape) for c in COLUMNS}

"""Tables of a device for system simulation, with their interpolation.

For example, over displacement and voltage: F(u, V), Q(u, V), C(u, V). A potential Pi is
interpolated, and the duals of all ports are its derivatives: F = dPi/du and Q = -dPi/dV. So
dF/dV = -dQ/du holds everywhere, not only at the nodes. The interpolation by piecewise cubic Hermite
polynomials uses Pi and its first derivatives at the nodes. The error of the duals between the nodes
falls with the third power of the spacing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.device.records import KINDS, PortKind
from dealib.errors import ConfigError, by_caller
from dealib.files import whole, write_text
from dealib.results.hdf5 import new_hdf5
from dealib.results.hermite import basis, nodal

if TYPE_CHECKING:
    import pandas

    from dealib.results.reader import Run

NAME = "tables"
POTENTIAL = "potential_mJ"
_KINDS = {kind.primal.column: kind for kind in KINDS.values()}


class DeviceTables:
    """A device as two or three ports, on a grid of their values.

    `tables["force_N"]` is an array over the grid, `tables["voltage_kV"]` an axis of it.

    Attributes:
        axes: Values of each variable by its column, ascending.
        values: Arrays over the grid by column: the dual of each variable, capacitances, and the
            potential, which is the elastic minus the electric energy.
        rows: Rows of the history from which the nodes were collected, (*grid).

    Args:
        columns: Axes and values by column.
        rows: See above.
    """

    def __init__(
        self, columns: Mapping[str, Array], rows: npt.NDArray[np.int64] | None = None
    ) -> None:
        self.rows = rows
        self.axes = {n: np.ravel(v) for n, v in columns.items() if _stem(n) in _KINDS}
        self.values = {n: v for n, v in columns.items() if n not in self.axes}
        shape = tuple(map(len, self.axes.values()))
        for name in (POTENTIAL, *map(_dual, self.axes)):
            if self.values[name].shape != shape:
                raise ValueError(f"{name} does not fit its grid")

    def __repr__(self) -> str:
        grid = " x ".join(f"{name} ({len(values)})" for name, values in self.axes.items())
        return f"<Tables {grid}: {', '.join(self.values)}>"

    @property
    def frame(self) -> pandas.DataFrame:
        """One row per node, indexed by the axes; with xarray, `to_xarray()` makes a dataset."""
        import pandas as pd

        index = pd.MultiIndex.from_product(list(self.axes.values()), names=list(self.axes))
        return pd.DataFrame({n: v.ravel() for n, v in self.values.items()}, index=index)

    def __getitem__(self, column: str) -> Array:
        return self.axes[column] if column in self.axes else self.values[column]

    def plain(self) -> dict[str, Array]:
        """All arrays by name."""
        return {**self.axes, **self.values}

    @property
    def duals(self) -> dict[str, Array]:
        """The dual of each axis by its name, such as 'force' or 'charge.left'."""
        return {
            _KINDS[_stem(axis)].dual.name + _suffix(axis): self.values[_dual(axis)]
            for axis in self.axes
        }

    # --- the interpolant -------------------------------------------------------------------------

    def potential(self, *at: Any) -> Array:
        """Pi, mJ.

        Args:
            at: Values of each axis, in its unit; arrays are broadcast.

        Raises:
            ValueError: If a value is outside the grid.
        """
        return self._derivative(at)

    def dual(self, name: str, *at: Any) -> Array:
        """A dual in the unit of its column.

        Args:
            name: 'force', 'charge', 'charge.left', ...
            at: As for `potential`.
        """
        axis = self._axis(name)
        return self._derivative(at, axis) * _factor(axis)

    def slope(self, name: str, by: str, *at: Any) -> Array:
        """Partial derivative of a dual with respect to an axis, in the units of both columns.

        Args:
            name: Name of the dual, such as 'force'.
            by: Name of the axis, such as 'displacement'.
            at: As for `potential`.
        """
        axis = self._axis(name)
        return self._derivative(at, axis, self._named(by)) * _factor(axis)

    def force(self, *at: Any) -> Array:
        """Force on the mount, N."""
        return self.dual("force", *at)

    def charge(self, *at: Any) -> Array:
        """Charge on the terminal, uC."""
        return self.dual("charge", *at)

    def stiffness(self, *at: Any) -> Array:
        """DF/du, N/mm."""
        return self.slope("force", "displacement", *at)

    def coupling(self, *at: Any) -> Array:
        """DF/dV, which is -dQ/du, N/kV."""
        return self.slope("force", "voltage", *at)

    def capacitance(self, *at: Any) -> Array:
        """Differential capacitance dQ/dV, pF; at 0 V if the voltage is not given."""
        if len(at) == len(self.axes) - 1:
            k = list(self.axes).index(self._named("voltage"))
            at = (*at[:k], 0.0, *at[k:])
        return 1e3 * self.slope("charge", "voltage", *at)

    def _axis(self, dual: str) -> str:
        """The axis of a dual."""
        for axis in self.axes:
            if _KINDS[_stem(axis)].dual.name + _suffix(axis) == dual:
                return axis
        raise ValueError(f"the tables have no {dual}")

    def _named(self, variable: str) -> str:
        """The axis of a variable."""
        for axis in self.axes:
            if _KINDS[_stem(axis)].primal.name + _suffix(axis) == variable:
                return axis
        raise ValueError(f"the tables have no {variable}")

    @cached_property
    def _nodal(self) -> dict[tuple[bool, ...], Array]:
        slopes = [self.values[_dual(axis)] / _factor(axis) for axis in self.axes]
        return nodal(list(self.axes.values()), self.values[POTENTIAL], slopes)

    @property
    def derivatives(self) -> Array:
        """Derivatives of Pi at the nodes in the axes' units, (*grid, 2^axes), see `nodal`."""
        return np.stack(list(self._nodal.values()), axis=-1)

    def _derivative(self, at: tuple[Any, ...], *by: str) -> Array:
        if len(at) != len(self.axes):
            raise ValueError(f"expected values of {', '.join(self.axes)}")
        points = np.broadcast_arrays(*(np.asarray(x, float) for x in at))
        cells, bases = [], []
        for (name, grid), x in zip(self.axes.items(), points, strict=True):
            variable = _KINDS[_stem(name)].primal
            told = variable.name + _suffix(name), variable.unit
            cell, of_node = basis(grid, x, by.count(name), *told)
            cells.append(cell)
            bases.append(of_node)
        total = np.zeros(points[0].shape)
        for of, values in self._nodal.items():
            for corner in product((0, 1), repeat=len(cells)):
                weight: Any = 1.0
                for of_node, slope, side in zip(bases, of, corner, strict=True):
                    weight = weight * of_node[slope][side]
                total += weight * values[tuple(c + s for c, s in zip(cells, corner, strict=True))]
        return total

    # --- files -----------------------------------------------------------------------------------

    def save(self, folder: Path) -> list[Path]:
        """Write tables.csv (one row a node), tables.h5 and tables.mat; returns their paths.

        In Octave's names dots are underscores.

        Raises:
            PlatformError: If the disk refuses.
        """
        from scipy.io import savemat

        paths = [folder / f"{NAME}.{ending}" for ending in ("csv", "h5", "mat")]
        nodes = np.meshgrid(*self.axes.values(), indexing="ij")
        rows = np.stack([*nodes, *self.values.values()], axis=-1).reshape(-1, len(self.plain()))
        lines = [",".join(self.plain()), *(",".join(map(repr, r)) for r in rows.tolist())]
        write_text(paths[0], "\n".join(lines) + "\n")
        with new_hdf5(paths[1]) as file:
            for name, values in self.plain().items():
                file[name] = values
            file.attrs["columns"] = list(self.plain())
        with whole(paths[2]) as temporary:
            plain = {name.replace(".", "_"): values for name, values in self.plain().items()}
            plain["columns"] = np.array(list(self.plain()), dtype=object)
            savemat(str(temporary), plain, oned_as="row")
        return paths


def _stem(column: str) -> str:
    return column.partition(".")[0]


def _suffix(column: str) -> str:
    return column[len(_stem(column)) :]


def _dual(axis: str) -> str:
    """Column of the dual of an axis."""
    return _KINDS[_stem(axis)].dual.column + _suffix(axis)


def _factor(axis: str) -> float:
    """Factor from the derivative of Pi with respect to an axis to its dual, in columns' units."""
    kind: PortKind = _KINDS[_stem(axis)]
    return kind.sign * kind.primal.factor * kind.dual.factor


def collect(run: Run) -> DeviceTables:
    """Collect the tables of a run whose config has the key `tables`.

    Raises:
        ConfigError: If the config has no `tables`, or not all nodes of the grid are solved.
    """
    wanted = run.config.tables
    if wanted is None:
        raise ConfigError(f"{run.directory}: its config has no tables")
    h, device = run.history, run.config.device
    axes = {
        device.column(name): np.sort(grid * device.variables[name].kind.primal.factor)
        for name, grid in wanted.grids.items()
    }
    names = [*map(_dual, axes), *(c for c in map(str, h) if _stem(c) == "capacitance_pF")]
    potential = h["elastic_energy_mJ"] - h["electric_energy_mJ"]
    rows = _rows(h[list(axes)].to_numpy(), list(axes.values()))
    if missing := int((rows < 0).sum()):
        raise ConfigError(f"{run.directory}: {missing} of {rows.size} nodes are not solved")
    columns = {name: h[name].to_numpy()[rows] for name in names}
    return DeviceTables({**axes, **columns, POTENTIAL: potential.to_numpy()[rows]}, rows)


def _rows(at: Array, grids: Sequence[Array]) -> npt.NDArray[np.int64]:
    """Row of the state at each node of a grid, (*grid); -1 where there is none."""
    sizes = np.array([np.ptp(grid) for grid in grids])
    found = np.full(tuple(map(len, grids)), -1)
    for index in np.ndindex(*found.shape):
        node = np.array([grid[i] for grid, i in zip(grids, index, strict=True)])
        off = np.linalg.norm((at - node) / sizes, axis=1)
        if off.min() < 1e-9:
            found[index] = off.argmin()
    return found


def load(path: str | Path) -> DeviceTables:
    """Tables from their folder, or from one of their files (.csv, .h5, .mat).

    Raises:
        ConfigError: If there are none.
    """
    path = Path(path)
    file = path / f"{NAME}.h5" if path.is_dir() else path
    if not file.is_file():
        makes = by_caller("dealib export CONFIG", "dealib.export_tables(case)")
        raise ConfigError(f"{path}: no tables here; {makes} makes them")
    try:
        return DeviceTables(dict(_read(file)))
    except Exception as error:  # the readers raise theirs as they come
        raise ConfigError(f"{file}: no tables of dealib ({error})") from None


def _read(file: Path) -> Iterator[tuple[str, Array]]:
    if file.suffix == ".h5":
        import h5py

        with h5py.File(file, "r") as content:
            yield from ((name, np.asarray(content[name][:])) for name in content.attrs["columns"])
    elif file.suffix == ".mat":
        from scipy.io import loadmat

        found = loadmat(str(file), chars_as_strings=True)
        for name in (str(np.ravel(n)[0]) for n in np.ravel(found["columns"])):
            yield name, found[name.replace(".", "_")]
    else:
        import pandas as pd

        rows = pd.read_csv(file, float_precision="round_trip")
        names = [str(name) for name in rows]
        axes = [name for name in names if _stem(name) in _KINDS]
        rows = rows.sort_values(axes)
        grids = {axis: np.unique(rows[axis]) for axis in axes}
        yield from grids.items()
        shape = tuple(map(len, grids.values()))
        yield from ((n, rows[n].to_numpy().reshape(shape)) for n in names if n not in grids)

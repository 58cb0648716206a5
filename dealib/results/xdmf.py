"""`fields.xdmf`: the fields of stored states for ParaView, readable after a kill at any moment."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.files import guarded, write_text
from dealib.log import LOGGER
from dealib.results.hdf5 import new_hdf5
from dealib.results.mesh import ResultMesh

FIELDS = "fields.xdmf"
FIELD_DATA = "fields"  # folder of the HDF5 files beside it


class FieldFile:
    """An XDMF time series: one grid per step, whose fields are in an HDF5 file of their own.

    Each file is written under a temporary name and then renamed. The HDF5 file of a step is written
    before the XML that refers to it.

    Args:
        directory: The run directory.
        mesh: Mesh of the fields.
        keep: Continue after this step; later ones are dropped.
        name: Name of the XDMF file.
    """

    _HEAD = '<?xml version="1.0" ?>\n<Xdmf Version="3.0"><Domain>\n'
    _HEAD += '<Grid Name="steps" GridType="Collection" CollectionType="Temporal">\n'
    _TAIL = "</Grid>\n</Domain></Xdmf>\n"

    def __init__(
        self, directory: Path, mesh: ResultMesh, keep: int = -1, name: str = FIELDS
    ) -> None:
        self.path, self.data = directory / name, directory / FIELD_DATA
        self._stem = "step" if name == FIELDS else self.path.stem
        with guarded(self.data):
            self.data.mkdir(exist_ok=True)
        self.mesh = mesh
        self._grids = self._reopen(keep)
        n, axes = mesh.points.shape
        points = np.column_stack([mesh.points, np.zeros((n, 3 - axes))])
        self._write("mesh.h5", {"points": points, "cells": mesh.cells, "region": mesh.region})

    def add(self, step: int, time: float, fields: Mapping[str, Array]) -> None:
        """Add a step; its time must be larger than that of the step before."""
        name = f"{self._stem}_{step:05d}.h5"
        self._write(name, fields)
        self._grids.append(self._grid(name, time, fields))
        write_text(self.path, self._HEAD + "".join(self._grids) + self._TAIL)

    def _reopen(self, keep: int) -> list[str]:
        """The XML of the grids up to step `keep`."""
        if keep < 0:
            return []
        text = self.path.read_text("utf-8", "replace") if self.path.is_file() else ""
        if not text.endswith(self._TAIL):
            LOGGER.warning("%s: missing or damaged; not all earlier steps are in it", self.path)
        grids = re.finditer(r'<Grid Name="step">.*?/step_(\d+)\.h5.*?</Grid>\n', text, re.DOTALL)
        return [g[0] for g in grids if int(g[1]) <= keep]

    def _write(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        size = 4.0 * sum(values.size for values in arrays.values())
        with new_hdf5(self.data / name, size) as file:
            for key, values in arrays.items():
                kind = "f4" if values.dtype.kind == "f" and name != "mesh.h5" else None
                file.create_dataset(key, data=values, dtype=kind)

    def _grid(self, name: str, time: float, fields: Mapping[str, Array]) -> str:
        cells, nodes = self.mesh.cells.shape
        n, kind = len(self.mesh.points), self.mesh.cell.xdmf_type
        lines = [
            f'<Grid Name="step"><Time Value="{time!r}" />',
            f'<Topology TopologyType="{kind}" NumberOfElements="{cells}">',
            _item("mesh.h5", "cells", (cells, nodes), "Int", 8) + "</Topology>",
            '<Geometry GeometryType="XYZ">'
            + _item("mesh.h5", "points", (n, 3), "Float", 8)
            + "</Geometry>",
            '<Attribute Name="region" AttributeType="Scalar" Center="Cell">'
            + _item("mesh.h5", "region", (cells,), "Int", 8)
            + "</Attribute>",
        ]
        for key, values in fields.items():
            sort = {1: "Scalar", 2: "Vector", 3: "Tensor"}[values.ndim]
            shape = (n,) if values.ndim == 1 else (n, int(np.prod(values.shape[1:])))
            lines.append(
                f'<Attribute Name="{key}" AttributeType="{sort}" Center="Node">'
                + _item(name, key, shape, "Float", 4)
                + "</Attribute>"
            )
        return "\n".join(lines) + "\n</Grid>\n"


def _item(file: str, key: str, shape: tuple[int, ...], kind: str, size: int) -> str:
    dims = " ".join(map(str, shape))
    return (
        f'<DataItem Dimensions="{dims}" NumberType="{kind}" Precision="{size}" Format="HDF">'
        f"{FIELD_DATA}/{file}:/{key}</DataItem>"
    )

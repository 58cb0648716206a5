"""Writes all numbers of a MAT file to standard output; run as a module in another process."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

HDF5 = b"\x89HDF"


def _variables(data: bytes) -> Mapping[str, Any]:
    if data.startswith(HDF5) or data[512:516] == HDF5:  # of version 7.3
        import h5py

        def tree(group: Any) -> dict[str, Any]:
            found: dict[str, Any] = {}
            for name, node in group.items():
                if isinstance(node, h5py.Group):
                    found[name] = {} if name == "#refs#" else tree(node)
                elif node.attrs.get("MATLAB_class", b"double") != b"char" and node.shape:
                    found[name] = np.asarray(node[()]).T
            return found

        with h5py.File(io.BytesIO(data), "r") as file:
            return tree(file)
    import scipy.io

    return dict(scipy.io.loadmat(io.BytesIO(data), simplify_cells=True))


def _flattened(node: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """All real vectors and matrices of nested structures, by dotted names."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            if not key.startswith("__"):
                yield from _flattened(value, f"{name}.{key}" if name else key)
    elif isinstance(node, list) or (isinstance(node, np.ndarray) and node.dtype == object):
        for i, value in enumerate(node, start=1):
            yield from _flattened(value, f"{name}({i})")
    elif isinstance(node, np.ndarray) and node.dtype.kind in "fiu":
        values = np.squeeze(np.asarray(node, dtype=float))
        if values.ndim in (1, 2) and len(values) > 1:
            yield name, values


if __name__ == "__main__":
    try:
        found = dict(_flattened(_variables(Path(sys.argv[1]).read_bytes())))
    except Exception as error:  # damaged files fail in many ways
        sys.exit(str(error) or type(error).__name__)
    stream = io.BytesIO()
    np.savez(stream, *found.values(), names=np.array(list(found), dtype=str))
    sys.stdout.buffer.write(stream.getvalue())

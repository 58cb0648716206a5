"""Reading Gmsh's mesh files, in its formats 4.1 and 2.2 as text.

Gmsh itself never opens a user's file: it would run scripts in it or in an option file beside it,
and damaged numbers make it crash.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.errors import ConfigError
from dealib.reading import read_bytes, shown

_FAR = 1e9  # mm
_MOST = 1_000_000_000  # bytes: some ten million nodes
# Gmsh's element types -> dimension, number of nodes and of corners
TYPES = {
    15: (0, 1, 1),
    **{1: (1, 2, 2), 8: (1, 3, 2)},
    **{2: (2, 3, 3), 9: (2, 6, 3), 3: (2, 4, 4), 10: (2, 9, 4), 16: (2, 8, 4)},
    **{4: (3, 4, 4), 11: (3, 10, 4), 5: (3, 8, 8), 12: (3, 27, 8), 17: (3, 20, 8)},
}
_KINDS = "triangles, quadrilaterals, tetrahedra and hexahedra of first or second order"
_NO_MESH = "no mesh of Gmsh's, which begins with $MeshFormat"
_HEAD = re.compile(rb"\s*\$(\w+)[ \t]*\r?\n")
_NAME = re.compile(r'([0-3]) (\d+) "([^"\x00-\x1f]*)"\s*')


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds.

    Attributes:
        names: Names of physical groups, by dimension and tag.
        groups: Tags of the physical groups of each of Gmsh's entities, by dimension and entity.
        points: Coordinates of the nodes, (nodes, 3).
        elements: Nodes of the elements by dimension, entity and type, (elements, nodes of one).
    """

    names: dict[tuple[int, int], str]
    groups: Mapping[tuple[int, int], set[int]]
    points: Array
    elements: dict[tuple[int, int, int], Ints]

    def into(self, model: Any) -> None:
        """Build the mesh in Gmsh's current model."""
        entities = list(dict.fromkeys((dim, entity) for dim, entity, _ in self.elements))
        for dim, entity in entities:
            model.addDiscreteEntity(dim, entity)
        if entities:
            tags = np.arange(1, len(self.points) + 1)
            model.mesh.addNodes(*entities[-1], tags, self.points.ravel())
        for (_, entity, kind), nodes in self.elements.items():
            model.mesh.addElementsByType(entity, kind, [], (nodes + 1).ravel())
        for (dim, tag), name in self.names.items():
            members = [e for d, e in entities if d == dim and tag in self.groups.get((d, e), ())]
            if members:
                model.addPhysicalGroup(dim, members, tag, name)

    def cells(self, dim: int) -> dict[str, list[Array]]:
        """Corners of the named cells of a dimension, (cells, corners, 3) by kind of cell."""
        found: dict[str, list[Array]] = defaultdict(list)
        for (of, entity, kind), nodes in self.elements.items():
            for tag in self.groups.get((of, entity), ()) if of == dim else ():
                if (of, tag) in self.names:
                    corners = nodes[:, : TYPES[kind][2]]
                    found[self.names[of, tag]].append(self.points[corners])
        return dict(found)


def read(path: Path) -> MeshFile:
    """Read a mesh file.

    Raises:
        ConfigError: If it is not a mesh of Gmsh, or is damaged.
    """
    content = read_bytes(path, "mesh", _MOST)
    try:
        return _parsed(dict(_sections(content)))
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def physical_names(path: Path) -> dict[str, int]:
    """Names and dimensions of the physical groups of a mesh file; the rest is not parsed.

    Raises:
        ConfigError: If it is no mesh of Gmsh, or has no names.
    """
    content = read_bytes(path, "mesh", _MOST)
    if not content.startswith(b"$MeshFormat"):
        raise ConfigError(f"{path}: {_NO_MESH}")
    named = content.partition(b"$PhysicalNames")[2].partition(b"$EndPhysicalNames")[0]
    found = {name: dim for (dim, _), name in _names(named).items()}
    if not found:
        raise ConfigError(f"{path}: the mesh has no physical names, which say what its parts are")
    return found


def _names(section: bytes) -> dict[tuple[int, int], str]:
    lines = map(_NAME.fullmatch, _text(section).splitlines())
    return {(int(line[1]), int(line[2])): line[3] for line in lines if line}


def _parsed(sections: dict[str, bytes]) -> MeshFile:
    """The mesh of the sections of a file."""
    version, kind = (*map(_text, sections["MeshFormat"].split()[:2]), "", "")[:2]
    if version not in ("2.2", "4.1") or kind != "0":
        raise ValueError(
            f"Gmsh's format {shown(version, 40)}{'' if kind == '0' else ', binary'}: dealib reads "
            "4.1 and 2.2 as text; 'gmsh OLD.msh -save -format msh41 -o NEW.msh' converts it"
        )
    names = _names(sections.get("PhysicalNames", b""))
    nodes, elements = (_Numbers(name, sections.get(name, b"0 0 0 0")) for name in _NEEDED)
    groups: dict[tuple[int, int], set[int]] = {}
    if version == "4.1":
        groups = dict(_entities(_Numbers("Entities", sections.get("Entities", b"0 0 0 0"))))
        tags, points = _nodes(nodes)
        parts = _blocks(elements)
    else:
        rows = nodes.take(nodes.counts(1)[0], 4)
        tags, points = rows[:, 0], rows[:, 1:]
        parts = _runs(elements)
    if not (abs(points) < _FAR).all():
        raise ValueError("the coordinates of a node are not finite, or beyond 1e9 mm")
    order = np.argsort(tags)
    known = tags[order]
    if (np.diff(known) == 0).any():
        raise ValueError("two nodes have the same number")
    found: dict[tuple[int, int, int], list[Ints]] = defaultdict(list)
    for key, wanted in parts:
        place = np.searchsorted(known, wanted).clip(max=max(len(known) - 1, 0))
        if not len(known) or (known[place] != wanted).any():
            raise ValueError("an element refers to a node that does not exist")
        found[key].append(order[place])
        if version == "2.2":
            groups[key[:2]] = {key[1]}
    return MeshFile(names, groups, points, {k: np.concatenate(v) for k, v in found.items()})


_NEEDED = ("Nodes", "Elements")


def _sections(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Names and texts of the sections of a file."""
    if not content.startswith(b"$MeshFormat"):
        raise ValueError(_NO_MESH)
    at = 0
    while rest := content[at : at + 100].strip():
        head = _HEAD.match(content, at)
        if head is None:
            raise ValueError(f"unexpected text {shown(_text(rest), 40)!r} between its sections")
        end = content.find(b"$End" + head[1], head.end())
        if end < 0:
            raise ValueError(f"the file is cut off: it ends within ${_text(head[1])}")
        yield _text(head[1]), content[head.end() : end]
        at = end + 4 + len(head[1])


def _text(content: bytes) -> str:
    return content.decode(errors="replace")


class _Numbers:
    """The numbers of a section, taken one after the other."""

    def __init__(self, name: str, content: bytes) -> None:
        self._name, self._at = name, 0
        try:
            self._all = np.array(content.split(), dtype=np.float64)
        except ValueError:
            raise ValueError(f"${name} holds something that is not a number") from None

    def take(self, *shape: int) -> Array:
        """The next numbers, in a shape."""
        n = math.prod(shape)
        if not 0 <= n <= len(self._all) - self._at:
            raise ValueError(f"${self._name} holds fewer numbers than it announces")
        self._at += n
        return self._all[self._at - n : self._at].reshape(shape)

    def counts(self, n: int) -> list[int]:
        """The next numbers, which must be counts or tags."""
        found = self.take(n)
        if not (abs(found) < 2**31).all() or (found % 1 != 0).any():
            raise ValueError(f"${self._name} holds a count or tag that is not a whole number")
        return [int(v) for v in found]

    def peek(self, n: int) -> list[int]:
        """The same without taking them."""
        found = self.counts(n)
        self._at -= n
        return found

    def rest(self, width: int) -> Array:
        """The numbers that have not been taken, in rows of a width."""
        left = self._all[self._at :]
        return left[: len(left) // max(width, 1) * width].reshape(-1, max(width, 1))


def _entities(numbers: _Numbers) -> Iterator[tuple[tuple[int, int], set[int]]]:
    """Physical groups of each entity."""
    for dim, n in enumerate(numbers.counts(4)):
        for _ in range(n):
            (tag,) = numbers.counts(1)
            numbers.take(6 if dim else 3)
            yield (dim, tag), {abs(group) for group in numbers.counts(*numbers.counts(1))}
            if dim:
                numbers.counts(*numbers.counts(1))


def _nodes(numbers: _Numbers) -> tuple[Array, Array]:
    """Numbers and coordinates of the nodes of format 4.1."""
    tags, points = [np.empty(0)], [np.empty((0, 3))]
    for _ in range(numbers.counts(4)[0]):
        dim, _, parametric, n = numbers.counts(4)
        tags.append(numbers.take(n))
        points.append(numbers.take(n, 3 + dim * bool(parametric))[:, :3])
    return np.concatenate(tags), np.concatenate(points)


def _blocks(numbers: _Numbers) -> Iterator[tuple[tuple[int, int, int], Array]]:
    """Dimension, entity, type and nodes of the elements of format 4.1."""
    for _ in range(numbers.counts(4)[0]):
        _, entity, kind, n = numbers.counts(4)
        dim, size = _kind(kind)
        yield (dim, entity, kind), numbers.take(n, 1 + size)[:, 1:]


def _runs(numbers: _Numbers) -> Iterator[tuple[tuple[int, int, int], Array]]:
    """The same of format 2.2, where each element names its groups; a group is an entity here."""
    (left,) = numbers.counts(1)
    while left > 0:
        _, kind, tags = numbers.peek(3)
        dim, size = _kind(kind)
        rows = numbers.rest(3 + tags + size)[:left]
        same = (rows[:, 1:3] == (kind, tags)).all(axis=1)
        n = len(same) if same.all() else int(np.argmin(same))
        rows, left = numbers.take(max(n, 1), 3 + tags + size), left - max(n, 1)
        for group in np.unique(rows[:, 3]) if tags else ():
            if group > 0:
                yield (dim, int(group), kind), rows[rows[:, 3] == group, -size:]


def _kind(kind: int) -> tuple[int, int]:
    if kind not in TYPES:
        raise ValueError(f"cells must be {_KINDS}, not Gmsh's type {kind}")
    return TYPES[kind][:2]

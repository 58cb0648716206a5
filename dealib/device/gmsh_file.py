"""What a Gmsh file says of itself before Gmsh reads it: its physical names."""

from __future__ import annotations

from pathlib import Path

from dealib.errors import ConfigError


def physical_names(path: Path) -> dict[str, int]:
    """Names and dimensions of the physical groups of a mesh file.

    Raises:
        ConfigError: If it is no mesh of Gmsh, or has no names.
    """
    found: dict[str, int] = {}
    try:
        with path.open("rb") as file:
            if file.readline().strip() != b"$MeshFormat":
                raise ConfigError(f"{path}: no mesh of Gmsh, which begins with $MeshFormat")
            heads = (line.strip() for line in file)
            first = next((h for h in heads if h in (b"$PhysicalNames", b"$Nodes")), b"")
            count = int(next(file).split()[0]) if first == b"$PhysicalNames" else 0
            for _ in range(count):
                dim, _, name = next(file).decode("utf-8").split(maxsplit=2)
                found[name.strip().strip('"')] = int(dim)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the mesh: {error.strerror}") from None
    except (ValueError, StopIteration):
        raise ConfigError(f"{path}: its $PhysicalNames cannot be read") from None
    if not found:
        raise ConfigError(f"{path}: the mesh has no physical names, which say what its parts are")
    return found

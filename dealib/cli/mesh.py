"""`dealib mesh`: write and draw the mesh of a config."""

from __future__ import annotations

from pathlib import Path

import typer

from dealib.config.case import Case
from dealib.device import gmsh_model
from dealib.errors import ConfigError


def write_mesh(case: Case, path: Path, view: Path | None, overwrite: bool) -> None:
    """Write the mesh, and a picture of it if wanted.

    Raises:
        ConfigError: If a file is in the way or a folder is missing.
    """
    if path.suffix != ".msh":
        raise ConfigError(f"--out {path}: Gmsh's files end in .msh")
    if view is not None:
        from dealib.plots.style import FORMATS

        if view.suffix.lower() not in FORMATS:
            raise ConfigError(f"--view {view}: the name must end in {', '.join(FORMATS)}")
    for target in (path, view):
        if target is None:
            continue
        if target.exists() and not overwrite:
            raise ConfigError(f"{target} exists; choose another name, or --overwrite it")
        if not target.parent.is_dir():
            raise ConfigError(f"{target}: there is no folder {target.parent}")
    counts = gmsh_model.write(case.config, path)
    cells = ", ".join(f"{name} {n}" for name, n in counts.items())
    typer.echo(f"{path}: {sum(counts.values())} cells ({cells})")
    if view is not None:
        from dealib.plots.mesh import draw_mesh
        from dealib.plots.style import save, theme

        with theme():
            save(draw_mesh(path, case.config), view)
        typer.echo(str(view))

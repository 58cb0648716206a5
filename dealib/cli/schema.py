"""`dealib schema` and `dealib init`: JSON schemas, reference pages and templates."""

from __future__ import annotations

from pathlib import Path

import typer

from dealib.config.reference import SCHEMA_FILE
from dealib.errors import ConfigError
from dealib.files import write_text
from dealib.tasks.files import reference, schema_text, template


def write_schema(out: Path | None, *, of: str, page: bool, overwrite: bool) -> None:
    """Print or write the JSON schema, or the reference page, of one kind of file.

    Raises:
        ConfigError: If there is no such kind, the file exists already or its folder is missing.
    """
    text = reference(of) if page else schema_text(of)
    if out is None:
        typer.echo(text, nl=False)
        return
    _write(out, text, overwrite)
    typer.echo(str(out))


def write_template(name: str, out: Path | None) -> None:
    """Write a commented config; if its folder has no schema for editors, write that too.

    Raises:
        ConfigError: If there is no such template, or the file exists already.
    """
    text, path = template(name), out or Path(f"{name}.yaml")
    _write(path, text, overwrite=False)
    schema = path.parent / SCHEMA_FILE
    if not schema.exists():
        _write(schema, schema_text("config"), overwrite=False)
    typer.echo(f"{path}: next, dealib run {path}")


def _write(path: Path, text: str, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise ConfigError(f"{path} exists and is left as it is; choose another --out")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}")
    write_text(path, text)

"""`dealib schema` and `dealib init`: the schema for editors and people, and templates."""

from __future__ import annotations

from pathlib import Path

import typer
from pydantic import BaseModel

from dealib.config import reference
from dealib.config.templates import TEMPLATES, template
from dealib.errors import ConfigError, did_you_mean
from dealib.files import write_text


def _text(of: str, page: bool) -> str:
    """Schema or reference page of one kind of file."""
    if of == "config":
        return reference.reference() if page else reference.json_text()
    if of == "study":
        from dealib.study import reference as study
        from dealib.study.schema import Study

        return study.reference() if page else reference.json_text(Study)
    if of == "fit":
        from dealib.calibration import reference as fit
        from dealib.calibration.schema import Fit

        return fit.reference() if page else reference.json_text(Fit)
    if of == "coupon":
        from dealib.calibration import reference as fit
        from dealib.calibration.coupon_schema import Coupon

        return fit.coupon_reference() if page else reference.json_text(Coupon)
    if of == "design":
        from dealib.design.schema import Design

        keys = _keys(of, "`dealib optimise` and `dealib uncertainty`", Design)
        return keys if page else reference.json_text(Design)
    if of == "benchmark":
        from dealib.validation.schema import Benchmark

        keys = _keys(of, "`dealib validate`", Benchmark)
        return keys if page else reference.json_text(Benchmark)
    known = ("config", "study", "fit", "coupon", "design", "benchmark")
    raise ConfigError(f"--of {of}: unknown{did_you_mean(of, known)}")


def _keys(of: str, commands: str, model: type[BaseModel]) -> str:
    made = f"Made by `dealib schema --of {of} --reference` from the schema of {commands}."
    return "\n".join([f"# All keys of a {of}", "", made, *reference.sections(model)]) + "\n"


def write_schema(out: Path | None, *, of: str, page: bool, overwrite: bool) -> None:
    """Print or write the JSON schema, or the reference page, of one kind of file.

    Raises:
        ConfigError: If there is no such kind, the file exists or its folder does not.
    """
    text = _text(of, page)
    if out is None:
        typer.echo(text, nl=False)
        return
    _write(out, text, overwrite)
    typer.echo(str(out))


def write_template(name: str, out: Path | None) -> None:
    """Write a commented config, and the schema for the editor beside it if it is not there.

    Raises:
        ConfigError: If there is no such template, or the file exists.
    """
    if name not in TEMPLATES:
        raise ConfigError(f"--template {name}: unknown{did_you_mean(name, TEMPLATES)}")
    path = out or Path(f"{name}.yaml")
    _write(path, template(name), overwrite=False)
    schema = path.parent / reference.SCHEMA_FILE
    if not schema.exists():
        _write(schema, reference.json_text(), overwrite=False)
    typer.echo(f"{path}: next, dealib run {path}")


def _write(path: Path, text: str, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise ConfigError(f"{path} exists and is left as it is; choose another --out")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}")
    write_text(path, text)

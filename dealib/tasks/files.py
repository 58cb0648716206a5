"""Schemas, reference pages and templates of the files that dealib reads."""

from __future__ import annotations

import json
from importlib import import_module
from typing import Any

from pydantic import BaseModel

from dealib.config import reference as pages
from dealib.config.templates import TEMPLATES
from dealib.config.templates import template as text_of
from dealib.errors import ConfigError, by_caller, did_you_mean

_MODELS = {  # kind of file -> module and class of its schema, imported when it is asked for
    "config": ("config.schema", "Config"),
    "study": ("study.schema", "Study"),
    "fit": ("calibration.schema", "Fit"),
    "coupon": ("calibration.coupon_schema", "Coupon"),
    "design": ("design.schema", "Design"),
    "benchmark": ("validation.schema", "Benchmark"),
}
KINDS = (*_MODELS, "history")
_COMMANDS = {
    "design": "`dealib optimise` and `dealib uncertainty`",
    "benchmark": "`dealib validate`",
}


def schema(of: str = "config") -> dict[str, Any]:
    """JSON schema of a kind of file.

    Args:
        of: config, study, fit, coupon, design or benchmark.

    Raises:
        ConfigError: If there is no such kind.
    """
    return dict(json.loads(schema_text(of)))


def schema_text(of: str) -> str:
    """JSON schema of a kind of file, as text; see `schema`."""
    return pages.json_text(_model(of))


def reference(of: str = "config") -> str:
    """Page of all keys of a kind of file in Markdown.

    Args:
        of: config, study, fit, coupon, design or benchmark; history: page of all its columns.

    Raises:
        ConfigError: If there is no such kind.
    """
    if of == "history":
        from dealib.observe.reference import page

        return page()
    if of == "config":
        return pages.reference()
    if of == "study":
        from dealib.study import reference as study

        return study.reference()
    if of == "fit":
        from dealib.calibration import reference as fit

        return fit.reference()
    if of == "coupon":
        from dealib.calibration import reference as coupon

        return coupon.coupon_reference()
    model, commands = _model(of), _COMMANDS[of]
    made = f"Made by `dealib schema --of {of} --reference` from the schema of {commands}."
    return "\n".join([f"# All keys of a {of}", "", made, *pages.sections(model)]) + "\n"


def _model(of: str) -> type[BaseModel]:
    """The schema of a kind of file."""
    if of in _MODELS:
        module, name = _MODELS[of]
        found: type[BaseModel] = getattr(import_module(f"dealib.{module}"), name)
        return found
    option = by_caller("--of", "of")
    if of == "history":
        page = by_caller("--reference", "dealib.reference")
        raise ConfigError(f"{option} history: it has no schema; {page} gives a page of its columns")
    raise ConfigError(f"{option} {of}: unknown{did_you_mean(of, KINDS)}")


def template(name: str = "deap") -> str:
    """The text of a commented config to start from.

    Args:
        name: deap, benchmark, membrane, disc or rectangle.

    Raises:
        ConfigError: If there is no such template.
    """
    if name not in TEMPLATES:
        given = by_caller("--template ", "")
        raise ConfigError(f"{given}{name}: unknown{did_you_mean(name, TEMPLATES)}")
    return text_of(name)

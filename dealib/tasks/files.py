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
_PAGES = {  # likewise, module and function of pages that are more than a schema
    "history": ("observe.reference", "page"),
    "config": ("config.reference", "reference"),
    "study": ("study.reference", "reference"),
}
_ALL_KEYS = """\
# All keys of a {of}

Made by `dealib schema --of {name} --reference` from the schema {source}"""
_SOURCES = {
    "fit": """that `dealib calibrate` applies.
The keys of the config that is fitted are in [configs](../REFERENCE.md), those of fits to tests of a
material alone in [COUPONS.md](COUPONS.md).""",
    "coupon": """that `dealib calibrate` applies to
files with `tests`. The laws and their parameters are those of [configs](../REFERENCE.md).""",
    "design": "of `dealib optimise` and `dealib uncertainty`.",
    "benchmark": "of `dealib validate`.",
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
    if of in _PAGES:
        module, name = _PAGES[of]
        return str(getattr(import_module(f"dealib.{module}"), name)())
    model, what = _model(of), "coupon fit" if of == "coupon" else of
    head = _ALL_KEYS.format(of=what, name=of, source=_SOURCES[of])
    return "\n".join([head, *pages.sections(model)]) + "\n"


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

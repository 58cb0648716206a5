"""`dealib materials`: list the laws, or draw one law's own response."""

from __future__ import annotations

import textwrap
from pathlib import Path

import typer

from dealib.errors import ConfigError, did_you_mean
from dealib.materials.laws import LAWS, Law
from dealib.materials.published import library
from dealib.tasks import measuring


def list_laws() -> str:
    """All laws with the meaning of their parameters, and all materials of the library."""
    rows = []
    for name, law in LAWS.items():
        rows.append(f"{name}: {(law.__doc__ or '').splitlines()[0].partition(': ')[2]}")
        for parameter in law.names():
            rows.append(f"    {parameter:<16} {law.model_fields[parameter].description}")
    rows.append("Each law also takes youngs_modulus in place of its moduli, with nu = 0.49.")
    rows.append("Moduli need a unit, such as '0.25 MPa'.")
    rows += ["", "Known materials, for library: NAME in a config:"]
    for name, entry in library().items():
        rows.append(f"{name}: {entry.description}")
        rows.append(f"    {entry.words}")
        rows.extend(f"    {line}" for line in textwrap.wrap(entry.source, 96))
    return "\n".join(rows)


def given_law(name: str, settings: list[str]) -> Law:
    """A law with parameters.

    Args:
        name: Name of a law or of a material.
        settings: Parameters as `key=value`; none: those of the material, or the law's example.

    Raises:
        ConfigError: If the law or a parameter is unknown or wrong.
    """
    values = {}
    for setting in settings:
        key, sign, value = setting.partition("=")
        if not sign:
            raise ConfigError(f"--set {setting}: expected KEY=VALUE, such as c10='0.25 MPa'")
        values[key.strip()] = value.strip()
    return measuring.law(name, **values)


def law_of_config(path: Path, region: str) -> tuple[str, Law]:
    """Name and law of a region of a config.

    Raises:
        ConfigError: If the config is wrong or has no such region.
    """
    from dealib.config import load

    known = load(path).config.materials
    if region not in known:
        hint = did_you_mean(region, known)
        raise ConfigError(f"--region {region}: {path} has no such material{hint}")
    return known[region].law, known[region]


def plot_law(law: Law, name: str, largest: float, out: Path, dark: bool, overwrite: bool) -> None:
    """Draw a law and print the largest stretch at which it is stable.

    Raises:
        ConfigError: If the picture exists already or its name has another suffix.
    """
    from dealib.materials.response import MODES, locking_stretch, stability_limit
    from dealib.plots.materials import draw_law
    from dealib.plots.style import FORMATS, check_target

    check_target(out, FORMATS, overwrite)
    draw_law(law, name, largest, out, dark)
    for mode in MODES:
        limit, end = stability_limit(law, mode), locking_stretch(law, mode)
        text = f"stable to {limit:.4f}"
        if limit == float("inf"):
            text = "stable up to a stretch of 10" if end == limit else f"stable; locks at {end:.4f}"
        typer.echo(f"{mode:<14} {text}")
    typer.echo(str(out))

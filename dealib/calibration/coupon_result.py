"""A fitted material as keys of a config, and as an entry of a user's library."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter, ValidationError

from dealib.calibration.candidates import Candidate
from dealib.calibration.coupon_data import CouponPlan
from dealib.calibration.task import FitResult
from dealib.config.case import yaml_text
from dealib.config.materials import Material

Values = dict[str, Any]


def material(plan: CouponPlan, candidate: Candidate, found: FitResult) -> Values:
    """Keys of a material in a config."""
    wanted, values, unit = plan.coupon.material, found.values, candidate.unit

    def quantity(value: float, unit: str = unit) -> str:
        return f"{value:.6g} {unit}"

    out: Values = {"law": candidate.law.name()}
    for key in [*candidate.moduli, *candidate.shapes]:
        name, _, index = key.partition(".")
        value = values[key]
        text: Any = quantity(value) if key in candidate.moduli else float(f"{value:.6g}")
        if index:
            out.setdefault(name, []).append(text)
        else:
            out[name] = text
    branches = [
        {
            "shear_modulus": quantity(values[f"branches.{k}.shear_modulus"]),
            "relaxation_time": quantity(values[f"branches.{k}.relaxation_time"], "s"),
            **({"evolution": candidate.evolution} if candidate.evolution == "network" else {}),
        }
        for k in range(candidate.branches)
    ]
    bulk = wanted.bulk_modulus
    if bulk is None:
        fast = sum(values[f"branches.{k}.shear_modulus"] for k in range(candidate.branches))
        scale = 1e-3 if unit == "kPa" else 1.0
        bulk = 1e3 * (candidate.fitted(values).shear_modulus_at_rest + scale * fast)
    out["bulk_modulus"] = quantity(bulk, "MPa")
    if branches:
        out["branches"] = branches
    for e in found.estimates:
        section, _, name = e.key.partition(".")
        if section in ("mullins", "permanent_set"):
            text = quantity(e.value, e.unit) if e.unit else float(f"{e.value:.6g}")
            out.setdefault(section, {})[name] = text
    permittivity = plan.coupon.model_dump()["material"]["relative_permittivity"]
    return out if permittivity is None else {**out, "relative_permittivity": permittivity}


def complaint(values: Values) -> str:
    """Why a config would refuse a material; empty if it accepts it."""
    given = {k: v for k, v in values.items() if k != "relative_permittivity"}
    try:
        TypeAdapter(Material).validate_python(given)
    except ValidationError as error:
        return str(error.errors()[0]["msg"]).removeprefix("Value error, ")
    return ""


def as_config(plan: CouponPlan, values: Values) -> str:
    """The material as a section of a config, in YAML."""
    head = [f"# Fitted by dealib calibrate to the tests of {plan.source.path.name}."]
    if "relative_permittivity" not in values:
        head.append("# A film also needs its relative_permittivity.")
    return "\n".join([*head, yaml_text({"materials": {"film": values}})])


def entry(plan: CouponPlan, candidate: Candidate, values: Values) -> Values:
    """An entry of a library of materials."""
    ranges = [
        f"{s.path.mode} {s.path.stretch.min():.3g} to {s.path.stretch.max():.3g}"
        for s in plan.specimens
    ]
    source = f"fitted by dealib calibrate to {plan.source.path.name}: "
    source += ", ".join(dict.fromkeys(ranges))
    return {
        "description": plan.coupon.description or candidate.label,
        "source": source,
        "values": values,
    }

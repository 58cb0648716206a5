"""Commented configs to start from; their comments come from the schema."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dealib.config.reference import (
    MODELINE,
    Node,
    inner,
    json_schema,
    kind,
    meaning,
    properties,
    resolve,
    variants,
)

_STRIPS = {
    "shape": "annular_strips",
    "inner_radius": "8.35 mm",
    "outer_radius": "12.35 mm",
    "film_thickness": "30 um",
    "electrode_thickness": "10 um",
}

_FILM = {
    "law": "neo_hookean",
    "shear_modulus": "20 kPa",
    "bulk_modulus": "20 MPa",
    "relative_permittivity": 4.7,
}

TEMPLATES: dict[str, Node] = {
    "deap": {
        "name": "deap",
        "description": "Circular actuator with electrodes and air, force control",
        "geometry": _STRIPS | {"air_height": "6 mm"},
        "mesh": {"columns": 60, "film_rows": 4, "electrode_rows": 1, "grading": "ends"},
        "materials": {
            "film": {
                "law": "neo_hookean",
                "youngs_modulus": "1 MPa",
                "relative_permittivity": 3.0,
                "prestretch": 1.15,
            },
            "electrode": {"law": "neo_hookean", "youngs_modulus": "3 MPa"},
        },
        "program": [
            "{stage: prestrain, steps: 2}",
            "{stage: preload, duration: 10 s, mount: {force: -0.3 N}, steps: 10}",
            "{stage: hold, duration: 5 s}",
            "{stage: actuate, duration: 20 s, terminal: {voltage: [0 V, 2.5 kV, 0 V]}, steps: 20}",
        ],
        "output": {"fields": "every"},
    },
    "benchmark": {
        "name": "benchmark",
        "description": "Three strips without air, displacement control, for comparing codes",
        "geometry": _STRIPS,
        "mesh": {"columns": 60, "film_rows": 4, "electrode_rows": 1, "grading": "tanh"},
        "materials": {
            "film": {
                "law": "neo_hookean",
                "shear_modulus": "0.334 MPa",
                "bulk_modulus": "16.67 MPa",
                "relative_permittivity": 3.0,
                "prestretch": 1.15,
            },
            "electrode": {
                "law": "neo_hookean",
                "shear_modulus": "1 MPa",
                "bulk_modulus": "50 MPa",
            },
        },
        "program": [
            "{stage: prestrain}",
            "{stage: push, duration: 12 s, mount: {displacement: -3 mm}, steps: 12}",
            "{stage: actuate, duration: 5 s, terminal: {voltage: 2.5 kV}, steps: 5}",
        ],
        "output": {"fields": "every"},
    },
    "membrane": {
        "name": "membrane",
        "description": "Film alone, its faces are the electrodes; pushed out of plane",
        "geometry": {
            "shape": "annular_strips",
            "inner_radius": "10 mm",
            "outer_radius": "20 mm",
            "film_thickness": "70 um",
            "electrode_thickness": "0 um",
        },
        "mesh": {"columns": 120, "film_rows": 2},
        "materials": {
            "film": {
                "law": "neo_hookean",
                "shear_modulus": "1 MPa",
                "bulk_modulus": "1000 MPa",
                "relative_permittivity": 3.0,
                "prestretch": 1.2,
            },
        },
        "program": [
            "{stage: prestrain}",
            "{stage: push, duration: 20 s, mount: {displacement: -10 mm}, steps: 20}",
            "{stage: actuate, duration: 3 s, terminal: {voltage: 5 kV}, steps: 3}",
        ],
        "output": {"fields": "stage"},
    },
    "disc": {
        "name": "disc",
        "description": "Film in a rigid ring with a round electrode, whose circle grows",
        "geometry": {
            "shape": "laminate",
            "base": {"kind": "disc", "radius": "50 mm"},
            "layers": "[{name: film, thickness: 0.5 mm}]",
        },
        "mesh": {"columns": 60},
        "materials": {"film": _FILM | {"prestretch": 2}},
        "physics": {"model": "membrane"},
        "terminals": {
            "top": {"on": "film.top", "within": "[0 mm, 25 mm]"},
            "bottom": {"on": "film.bottom", "within": "[0 mm, 25 mm]", "ground": "true"},
        },
        "probes": {"edge": {"displacement": "R", "at": "[25 mm, 0 mm]"}},
        "program": [
            "{stage: prestrain}",
            "{stage: actuate, duration: 5 s, terminal: {voltage: 8 kV}, steps: 5}",
        ],
        "output": {"fields": "every"},
    },
    "rectangle": {
        "name": "rectangle",
        "description": "Film in a rigid frame with two electrodes side by side; one is driven",
        "geometry": {
            "shape": "laminate",
            "base": {"kind": "rectangle", "length": "40 mm", "width": "30 mm"},
            "layers": "[{name: film, thickness: 0.1 mm}]",
        },
        "mesh": {"columns": 16, "sectors": 6},
        "materials": {"film": _FILM | {"prestretch": "[2, 2]"}},
        "physics": {"model": "membrane"},
        "terminals": {
            "left": {"on": "film.top", "within": "{X: [-16 mm, -4 mm], Y: [-10 mm, 10 mm]}"},
            "right": {"on": "film.top", "within": "{X: [4 mm, 16 mm], Y: [-10 mm, 10 mm]}"},
            "ground": {"on": "film.bottom", "ground": "true"},
        },
        "probes": {"centre": {"displacement": "X", "at": "[0 mm, 0 mm, 0 mm]"}},
        "program": [
            "{stage: prestrain}",
            "{stage: actuate, duration: 5 s, terminals: {left: {voltage: 1.6 kV}}, steps: 5}",
        ],
        "output": {"fields": "every"},
    },
}


def template(name: str) -> str:
    """Text of a commented config.

    Args:
        name: A key of `TEMPLATES`.
    """
    schema = json_schema()
    lines = _lines(schema, TEMPLATES[name], schema["$defs"], "")
    return (
        "\n".join([MODELINE, "# All keys: dealib schema --reference", "", *lines]).rstrip() + "\n"
    )


def _lines(node: Node, values: Node, defs: Node, indent: str) -> Iterator[str]:
    """The lines of a section: keys with a value, and as comments the keys that could be added."""
    for key, value in node["properties"].items():
        given, (held, on) = values.get(key), inner(value)
        section = _chosen(value, given, defs)
        if key == "program":
            yield from (f"{key}:", *_stages(value, defs))
            yield from (f"  - {stage}" for stage in given or ())
            yield ""
        elif on == ".KEY" and given is not None:
            yield f"{indent}{key}:  # {meaning(value)}"
            for name, one in given.items():
                yield f"{indent}  {name}:"
                yield from _lines(_chosen(held, one, defs), one, defs, indent + "    ")
            yield ""
        elif "properties" in section:
            means = value.get("description") or section.get("description", "")
            mark = "" if given is not None else "# "
            yield f"{indent}{mark}{key}:  # {means}"
            if given is not None:
                yield from _lines(section, given, defs, indent + "  ")
            else:
                for line in _lines(section, {}, defs, "  "):
                    if line.strip():
                        yield f"{indent}# {line.replace('# ', '', 1)}"
            if not indent:
                yield ""
        elif given is not None:
            yield _line(indent, key, given, value)
        elif key not in node.get("required", ()) or not values:
            blank = "<name>" if "enum" in value else f"<{kind(value)}>"
            yield _line(indent + "# ", key, value.get("default", blank), value)


def _chosen(value: Node, given: Any, defs: Node) -> Node:
    """The section that a key holds; of alternatives, the one that the given values choose."""
    tagged = variants(value, defs)
    if tagged:
        by = value["discriminator"]["propertyName"]
        return tagged[given[by]] if given else next(iter(tagged.values()))
    return resolve(value, defs)


def _line(indent: str, key: str, given: Any, value: Node) -> str:
    means = meaning(value)
    choice = kind(value).replace("`", "") if "enum" in value else ""
    comment = "; ".join(t for t in (choice, means) if t)
    text = f"{indent}{key}: {given}"
    return f"{text:<40}  # {comment}" if comment else text


def _stages(value: Node, defs: Node) -> Iterator[str]:
    """Comments about the keys of a stage."""
    for key, item in properties(value["items"], defs).items():
        inner = resolve(item, defs)
        means = meaning(item) or inner.get("description", "")
        default = f"; default {item['default']}" if "default" in item else ""
        yield f"  # {key}: {means}{default}"
        for name, port in inner.get("properties", {}).items():
            parts = properties(port, defs)
            what = ", ".join(f"{n} ({kind(p)})" for n, p in parts.items())
            yield f"  #   {name} ({kind(port)}): {'; '.join(filter(None, (meaning(port), what)))}"

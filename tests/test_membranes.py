"""Membranes: against a meridian's ordinary differential equations, each other and closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from cffi import FFI
from laminates import config, layer, rows, simulation
from verification.references.annulus import Annulus, push
from verification.references.laws import Film, neo_hooke, slope
from verification.references.wrinkling import natural_width, onset, sheared_strip

from dealib.errors import NotConverged
from dealib.materials import coupon
from dealib.materials.laws import LAWS
from dealib.units import EPSILON_0

G, EPS = 0.334, 3.0
RUBBER = {  # as good as incompressible: without a pressure of its own a membrane does not lock
    "law": "neo_hookean",
    "shear_modulus": f"{G} MPa",
    "bulk_modulus": f"{1e4 * G} MPa",
    "relative_permittivity": EPS,
}
MEMBRANE = {"model": "membrane"}
SQUARE = {"kind": "rectangle", "length": "10 mm", "width": "8 mm"}


def ring(**sections):
    """An annulus of 30 um, pre-stretched by 1.15, pushed by 2 mm and driven by 1.5 kV."""
    base = {"kind": "annulus", "inner_radius": "8.35 mm", "outer_radius": "12.35 mm"}
    given = {
        "geometry": {"base": base, **sections.pop("geometry", {})},
        "mesh": {"columns": 16, **sections.pop("mesh", {})},
        "materials": {"film": RUBBER | {"prestretch": 1.15}},
        "physics": MEMBRANE,
        "program": [
            {"stage": "prestrain"},
            {"stage": "push", "mount": {"displacement": "2 mm"}, "steps": 3},
            {"stage": "actuate", "terminal": {"voltage": "1.5 kV"}},
        ],
    }
    return rows(config("annulus", layer(thickness="30 um"), **given | sections))


@pytest.mark.once
def test_an_annulus_is_that_of_the_meridian_s_equations():
    film = Film(neo_hooke(G), 0.030, 1.15, EPSILON_0 * EPS)
    for row, voltage in ((-2, 0.0), (-1, 1.5)):
        found = ring()[row]
        wanted = push(Annulus(film, 8.35, 12.35), 2.0, voltage)
        assert found["force_N"] == pytest.approx(wanted.force, rel=5e-4)
        assert found["capacitance_pF"] == pytest.approx(1e3 * wanted.capacitance, rel=2e-4)


@pytest.mark.once
def test_two_and_three_dimensions_agree():
    flat = ring()[-1]
    solid = {"geometry": {"space": "3d", "symmetry": ["X", "Y"]}, "mesh": {"sectors": 4}}
    base = {"kind": "annulus", "inner_radius": "8.35 mm", "outer_radius": "12.35 mm"}
    turned = ring(geometry={"base": base, **solid["geometry"]}, mesh=solid["mesh"])[-1]
    for name in ("force_N", "capacitance_pF", "elastic_energy_mJ", "charge_uC"):
        assert turned[name] == pytest.approx(flat[name], rel=2e-4), name


def square(program, law=RUBBER, terminals=None, **physics):
    """A square film whose edges move parallel to themselves: `plate` along X, `side` along Y."""
    given = {
        "geometry": {"base": SQUARE},
        "mesh": {"columns": 4, "sectors": 2, "grading": "uniform"},
        "materials": {"film": law},
        "physics": MEMBRANE | physics,
        "mounts": {
            "plate": {"on": "right", "along": "X", "free": ["Y", "Z"]},
            "side": {"on": "back", "along": "Y", "free": ["X", "Z"]},
        },
        "holds": [
            {"on": "left", "fix": "X"},
            {"on": "front", "fix": "Y"},
            {"on": "film.bottom", "fix": "Z"},
        ],
        "terminals": (terminals or {"top": {"on": "film.top"}})
        | {"ground": {"on": "film.bottom", "ground": True}},
        "program": program,
    }
    return rows(config("annulus", layer(thickness="50 um"), **given))


def pulled(voltage="0 kV", narrower="-1 mm"):
    """Pulled to 1.5 times its length, and made narrower than it would like to be."""
    return [
        {"stage": "pull", "mounts": {"plate": {"displacement": "5 mm"}}, "steps": 2},
        {"stage": "drive", "terminal": {"voltage": voltage}, "steps": 2},
        {"stage": "push", "mounts": {"side": {"displacement": narrower}}, "steps": 2},
    ]


@pytest.mark.parametrize("volts", [pytest.param(0.0, marks=pytest.mark.once), 2.0])
def test_a_tension_field_has_the_natural_width(volts):
    """Pushed further it only wrinkles: no force across, along that of the natural width."""
    slack = 1e-5
    program = pulled(f"{volts} kV", "-2 mm")
    end = square(program, wrinkling="tension_field", slack_stiffness=slack)[-1]
    pull = EPSILON_0 * EPS * (volts / 0.050) ** 2
    law = neo_hooke(G)
    width = natural_width(law, 1.5, pull)
    assert width > 0.75 + 0.01
    along = (slope(law, 1.5, width) - pull * 1.5 * width**2) * 0.050 * 8
    assert end["force_N.plate"] == pytest.approx(along, rel=3e-4)
    assert abs(end["force_N.side"]) < 5 * slack * along
    assert end["wrinkled_area_mm2"] == pytest.approx(80, rel=1e-9)
    # the field is that of the film, which is wider than the surface
    plates = EPSILON_0 * EPS * 80 / 0.050 * (1.5 * width) ** 2
    assert end["capacitance_pF"] == pytest.approx(1e3 * plates, rel=3e-4)


@pytest.mark.parametrize("wrinkling", ["taut", "tension_field"])
def test_capacitances_of_several_areas_are_charges_over_voltages(wrinkling):
    """Thickness and wrinkles follow the voltage; a capacitance is that of the body as it is."""
    parts = {
        "a": {"on": "film.top", "within": {"X": ["-5 mm", "-2.5 mm"]}},
        "b": {"on": "film.top", "within": {"X": ["0 mm", "5 mm"]}},
    }
    program = pulled(narrower="-2 mm")
    program[1] = {
        "stage": "drive",
        "terminals": {"a": {"voltage": "1 kV"}, "b": {"voltage": "2 kV"}},
    }
    soft = RUBBER | {"bulk_modulus": f"{20 * G} MPa"}
    end = square(program, soft, parts, wrinkling=wrinkling)[-1]
    for name, volts in (("a", 1.0), ("b", 2.0)):
        found = end[f"capacitance_pF.{name}.{name}"]
        assert found == pytest.approx(1e3 * end[f"charge_uC.{name}"] / volts, rel=1e-9)
    assert end["capacitance_pF.a.b"] == pytest.approx(0, abs=1e-9)


@pytest.mark.once
def test_a_taut_film_bears_what_a_tension_field_does_not():
    start, *_, taut = square(pulled(narrower="-2 mm"))
    assert start["capacitance_pF"] == pytest.approx(1e3 * EPSILON_0 * EPS * 80 / 0.050, rel=1e-9)
    assert taut["force_N.side"] < -0.01
    assert taut["wrinkling_use"] > 1
    assert "wrinkled_area_mm2" not in taut


@pytest.mark.once
def test_a_film_begins_to_wrinkle_at_its_voltage():
    """Held at 1.2 x 1.2 it is taut just below the voltage of the reference, wrinkled above."""
    begins = onset(neo_hooke(G), 1.2, 1.2, EPSILON_0 * EPS) * 0.050
    pull = {"plate": {"displacement": "2 mm"}, "side": {"displacement": "1.6 mm"}}
    program = [
        {"stage": "pull", "mounts": pull, "steps": 2},
        {"stage": "below", "terminal": {"voltage": f"{0.998 * begins} kV"}, "steps": 3},
        {"stage": "above", "terminal": {"voltage": f"{1.002 * begins} kV"}},
    ]
    found = square(program, wrinkling="tension_field")
    areas = {row["stage"]: row["wrinkled_area_mm2"] for row in found}
    assert areas["below"] == 0
    assert areas["above"] == pytest.approx(80)


@pytest.mark.once
def test_slack_everywhere_it_has_the_stiffness_that_is_left():
    """Pressed both ways: springs of the share of the modulus that is left bear it."""
    slack = 0.01
    program = [
        {
            "stage": "press",
            "mounts": {"plate": {"displacement": "-1 mm"}, "side": {"displacement": "-0.8 mm"}},
            "steps": 2,
        }
    ]
    end = square(program, wrinkling="tension_field", slack_stiffness=slack)[-1]
    left = slack * G * (0.9 - 1) * 0.050 * 8
    assert end["force_N.plate"] == pytest.approx(left, rel=1e-3)


def sheared(length, cells, wrinkling):
    """A strip of 10 mm between clamps, one of which moves along the other by 3 mm.

    Returns:
        The force, N, and the number of negative modes.
    """
    given = config(
        "annulus",
        layer(thickness="50 um"),
        geometry={"base": SQUARE | {"length": f"{length} mm", "width": "10 mm"}},
        mesh={"columns": cells[0], "sectors": cells[1], "grading": "uniform"},
        materials={"film": RUBBER | {"bulk_modulus": "334 MPa", "prestretch": 1.01}},
        physics=MEMBRANE | {"wrinkling": wrinkling},
        mounts={"edge": {"on": "back", "along": "X"}},
        holds=[{"on": "front", "fix": ["X", "Y", "Z"]}],
        program=[
            {"stage": "prestrain"},
            {"stage": "shear", "mounts": {"edge": {"displacement": "3 mm"}}, "steps": 4},
        ],
    )
    run = simulation(given)
    force = [state.row["force_N"] for state in run][-1]
    return force, run.engine.newton.unstable_modes()


@pytest.mark.slow
def test_a_sheared_strip_wrinkles_alike_on_every_mesh():
    """Wagner's web: the force of a piece far from the ends is that of an endless strip.

    A taut strip bears a fifth more, and has the more negative modes, the finer its mesh is.
    """
    short, long = (sheared(n, (4 * n // 5, 4), "tension_field") for n in (20, 40))
    web = sheared_strip(neo_hooke(G), 0.3 * 1.01, 1.01, 1.01).nominal[0, 1]
    assert long[0] - short[0] == pytest.approx(web * 0.050 * 1.01 * 20, rel=5e-3)
    fine = sheared(20, (24, 6), "tension_field")
    assert fine[0] == pytest.approx(short[0], rel=3e-3)
    assert short[1] == long[1] == fine[1] == 0
    taut, refined = (sheared(20, cells, "taut") for cells in ((16, 4), (24, 6)))
    assert taut[0] > 1.15 * short[0]
    assert refined[1] > 1.5 * taut[1] > 50


@pytest.mark.once
@pytest.mark.parametrize(
    "law",
    [
        {"law": "yeoh", "c10": "0.15 MPa", "c20": "0.01 MPa", "c30": "0 MPa"},
        {"law": "gent", "shear_modulus": "0.3 MPa", "j_lim": 60},
    ],
    ids=lambda law: law["law"],
)
def test_other_laws_wrinkle_without_force_across(law):
    more = {"bulk_modulus": "3000 MPa", "relative_permittivity": EPS}
    program = pulled("1 kV", "-2 mm")
    end = square(program, law | more, wrinkling="tension_field", slack_stiffness=1e-5)[-1]
    assert abs(end["force_N.side"]) < 1e-4 * end["force_N.plate"]
    assert end["force_N.plate"] > 0.05
    assert np.isclose(end["wrinkled_area_mm2"], 80)


@pytest.mark.parametrize("wrinkling", ["taut", "tension_field"])
def test_the_tangent_s_pattern_is_known_before_the_first_step(wrinkling):
    """An entry that comes later makes PETSc copy the matrix: minutes instead of seconds."""
    given = config(
        "annulus",
        layer(thickness="30 um"),
        geometry={"space": "3d", "symmetry": ["X", "Y"]},
        mesh={"sectors": 4},
        physics=MEMBRANE | {"wrinkling": wrinkling},
        materials={"film": RUBBER | {"prestretch": 1.1}},
        program=[
            {"stage": "prestrain"},
            {"stage": "push", "mount": {"displacement": "1 mm"}, "steps": 2},
            {"stage": "actuate", "terminal": {"voltage": "0.5 kV"}},
        ],
    )
    run = simulation(given)
    steps = [state.row for state in run]
    assert steps[-1]["charge_uC"] > 0
    assert run.engine.newton.system.matrix.getInfo()["mallocs"] == 0


@pytest.mark.parametrize("wrinkling", ["taut", "tension_field"])
def test_another_membrane_of_the_same_kind_compiles_nothing(monkeypatch, wrinkling):
    """Its expressions have variables, whose numbers count up from one device to the next."""

    def built(thickness):
        physics = MEMBRANE | {"wrinkling": wrinkling}
        given = {"physics": physics, "materials": {"film": RUBBER | {"prestretch": 1.15}}}
        given["program"] = [{"stage": "on", "terminal": {"voltage": "0.1 kV"}}]
        *_, row = rows(config("annulus", layer(thickness=thickness), **given))
        assert row["charge_uC"] > 0

    built("30 um")  # compiled here at the latest

    def compile_called(*args, **kwargs):
        raise AssertionError("compiled again")

    monkeypatch.setattr(FFI, "compile", compile_called)
    built("40 um")


def test_a_flat_film_without_tension_bears_nothing_across():
    program = [{"stage": "push", "mount": {"displacement": "1 mm"}}]
    with pytest.raises(
        NotConverged, match=r"the tangent is singular: .*a slack film does not hold"
    ):
        ring(program=program, materials={"film": RUBBER})


@pytest.mark.once
@pytest.mark.parametrize("model", ["membrane", pytest.param("solid", marks=pytest.mark.slow)])
def test_branches_relax_in_space_as_at_a_material_point(model):
    """Pulled equally both ways in 1 s, then held: the stress of the one-dimensional solution."""
    film = RUBBER | {"branches": [{"shear_modulus": "0.2 MPa", "relaxation_time": "1 s"}]}
    both = {"plate": {"displacement": "5 mm"}, "side": {"displacement": "4 mm"}}
    program = [
        {"stage": "prestrain"},
        {"stage": "pull", "mounts": both, "steps": 20},
        {"stage": "hold", "duration": "2 s", "steps": 10},
    ]
    physics = {"model": model} | ({"formulation": "mixed"} if model == "solid" else {})
    found = square(program, film, **physics)
    time, stretch, corners = coupon.refined([0.0, 1.0, 3.0], [1.0, 1.5, 1.5])
    moduli = SimpleNamespace(shear_modulus=G, bulk_modulus=0.0)
    material = coupon.IncompressibleMaterial(LAWS["neo_hookean"], moduli, branches=((0.2, 1.0),))
    path = coupon.Path("equal-biaxial", time, stretch)
    (stress,) = coupon.stresses(path, [material])
    ends = {row["stage"]: row["force_N.plate"] / (0.050 * 8) for row in found}
    assert [ends["pull"], ends["hold"]] == pytest.approx(stress[corners[1:]].tolist(), rel=2e-3)
    assert found[-1]["dissipated_energy_mJ"] > 0


def test_the_field_of_a_second_film_of_the_same_material_counts():
    low, high = layer("low", "0.1 mm", material="film"), layer("high", "0.1 mm", material="film")
    terminals = {
        "hot": {"on": "high.top"},
        "ground": {"on": ["low.bottom", "low.top"], "ground": True},
    }
    program = [{"stage": "prestrain"}, {"stage": "actuate", "terminal": {"voltage": "2 kV"}}]
    film = RUBBER | {"prestretch": 1.1}
    given = {"physics": MEMBRANE, "terminals": terminals, "materials": {"film": film}}
    end = rows(config("annulus", low, high, program=program, **given))[-1]
    assert end["field_max_MV_per_m"] == pytest.approx(20, rel=0.05)


def test_a_locked_membrane_still_has_a_thickness():
    """Beyond its limit at constant volume a film grows in volume; the results find that as well."""
    gent = {"law": "gent", "shear_modulus": "15 kPa", "j_lim": 90, "bulk_modulus": "15 MPa"}
    found = rows(
        config(
            "disc",
            layer(thickness="12.5 um"),
            mesh={"columns": 10},
            physics={"model": "membrane"},
            materials={"film": {**gent, "relative_permittivity": 4.8, "prestretch": 4}},
            terminals={
                "top": {"on": "film.top", "within": ["0 mm", "3.33333 mm"]},
                "bottom": {"on": "film.bottom", "within": ["0 mm", "3.33333 mm"], "ground": True},
            },
            program=[
                {"stage": "prestrain", "steps": 3},
                {"stage": "actuate", "terminal": {"voltage": "2.4 kV"}, "steps": 20},
            ],
        )
    )
    assert found[-1]["locking_use"] > 1.02
    assert all(np.isfinite(row["field_max_MV_per_m"]) for row in found)
    assert np.sqrt(93 / 2) < found[-1]["stretch_max"] < 7  # the limit at constant volume

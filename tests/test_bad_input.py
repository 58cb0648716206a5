"""Bad inputs: each is one clear message with its place, exit code 2, and nothing is overwritten."""

import errno
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import said

from dealib.__main__ import main
from dealib.config import load
from dealib.errors import ConfigError

pytestmark = pytest.mark.once  # refused before dolfinx is asked
ROOT = Path(__file__).parent.parent

BASE = """\
name: case
geometry:
  inner_radius: 8 mm
  outer_radius: 12 mm
  film_thickness: 30 um
  electrode_thickness: 10 um
  air_height: 6 mm
mesh:
  columns: 8
materials:
  film:
    law: neo_hookean
    youngs_modulus: 1 MPa
    relative_permittivity: 3.0
    prestretch: 1.1
  electrode:
    law: neo_hookean
    youngs_modulus: 3 MPa
program:
  - {stage: prestrain}
  - {stage: push, mount: {displacement: -2 mm}, steps: 2}
  - {stage: actuate, terminal: {voltage: [0 V, 2 kV, 0 V]}, steps: 2}
"""

# (what, text in BASE, its replacement, message without the file name, text at the caret)
EDITS = [
    # keys
    ("misspelt key", "mesh:\n", "meshh:\n",
     "8:1: meshh: unknown key; did you mean 'mesh'?", "meshh:"),
    ("misspelt nested key", "inner_radius:", "iner_radius:",
     "3:3: geometry.iner_radius: unknown key; did you mean 'inner_radius'?", "iner_radius:"),
    ("unknown key", "columns: 8", "columns: 8\n  zebra: 1",
     "10:3: mesh.zebra: unknown key; known: columns, film_rows, electrode_rows, sectors, grading, "
     "order, air_size, file", "zebra: 1"),
    ("unknown key of a stage", "{stage: prestrain}", "{stage: prestrain, step: 2}",
     "20:24: program.0.step: unknown key; did you mean 'steps'?", "step: 2"),
    ("parameter of another law", "youngs_modulus: 3 MPa", "c10: 1 MPa",
     ["16:3: materials.electrode.shear_modulus: this key is missing: shear modulus G; such as "
      "'1 MPa'",
      "16:3: materials.electrode.bulk_modulus: this key is missing: bulk modulus kappa; needed "
      "unless youngs_modulus is given; such as "
      "'1 MPa'",
      "18:5: materials.electrode.c10: unknown key; known: library, relative_permittivity, "
      "density, prestretch, mounted, branches, mullins, permanent_set, youngs_modulus, law, "
      "shear_modulus, bulk_modulus"], "c10:"),
    ("missing key", "  outer_radius: 12 mm\n", "",
     "2:1: geometry.outer_radius: this key is missing: inner radius of the rigid frame; such as "
     "'30 um'", "geometry:"),
    ("missing section", BASE[BASE.index("program"):], "",
     "1:1: program: this key is missing", "name: case"),
    ("stage without a name", "{stage: prestrain}", "{steps: 1}",
     "20:5: program.0.stage: this key is missing: name; `prestrain` ramps the materials' "
     "pre-stretch from 1", "{steps: 1}"),
    ("duplicate key", "  columns: 8\n", "  columns: 8\n  columns: 10\n",
     "10:3: the key 'columns' is given twice", "columns: 10"),
    # units
    ("missing unit", "inner_radius: 8 mm", "inner_radius: 8",
     "3:17: geometry.inner_radius: expected a length with its unit, such as '30 um'; '8' has no "
     "unit", "8"),
    ("wrong dimension", "30 um", "30 s",
     "5:19: geometry.film_thickness: expected a length with its unit, such as '30 um'; 's' is not "
     "a unit of that kind", "30 s"),
    ("unknown unit", "1 MPa", "1 MPaa",
     "13:21: materials.film.youngs_modulus: expected a stress with its unit, such as '1 MPa'; "
     "'MPaa' is no unit; did you mean 'MPa'?", "1 MPaa"),
    ("no number", "8 mm", "eight mm",
     "3:17: geometry.inner_radius: expected a length with its unit, such as '30 um'; 'eight mm' "
     "does not start with a number", "eight mm"),
    ("nothing", "film_thickness: 30 um", "film_thickness:",
     "5:3: geometry.film_thickness: expected a length with its unit, such as '30 um', not nothing",
     "film_thickness:"),
    ("wrong unit in a polyline", "2 kV", "2 kA",
     "22:48: program.2.terminal.voltage.1: expected a voltage with its unit, such as '2.5 kV'; "
     "'kA' is not a unit of that kind", "2 kA"),
    ("infinite", "12 mm", "1e999 mm",
     "4:17: geometry.outer_radius: expected a length with its unit, such as '30 um'; '1e999 mm' "
     "is too large", "1e999 mm"),
    # values
    ("text for a number", "columns: 8", "columns: many",
     "9:12: mesh.columns: expected a whole number, not 'many'", "many"),
    ("fraction of a cell", "columns: 8", "columns: 8.5",
     "9:12: mesh.columns: expected a whole number, not 8.5", "8.5"),
    ("odd columns", "columns: 8", "columns: 9",
     "9:12: mesh.columns: must be a multiple of 2, not 9", "9"),
    ("too few columns", "columns: 8", "columns: 2",
     "9:12: mesh.columns: must be at least 4, not 2", "2"),
    ("unknown choice", "columns: 8", "grading: end",
     "9:12: mesh.grading: 'end' is not allowed; did you mean 'ends'?", "end"),
    ("permittivity", "permittivity: 3.0", "permittivity: -3",
     "14:28: materials.film.relative_permittivity: must be at least 1, not -3", "-3"),
    ("permittivity by stretch", "permittivity: 3.0", "permittivity: {intercept: 3, slop: -1}",
     "14:43: materials.film.relative_permittivity.slop: unknown key; did you mean 'slope'?",
     "slop"),
    ("permittivity that vanishes", "permittivity: 3.0", "permittivity: {intercept: 1, slope: -1}",
     "14:28: materials.film.relative_permittivity: must be at least 1, that of vacuum; it is 0 at "
     "the stretch 1", "{intercept"),
    ("permittivity below 1 as mounted", "permittivity: 3.0",
     "permittivity: {intercept: 2, slope: -0.95}",
     "14:28: materials.film.relative_permittivity: must be at least 1, that of vacuum; it is 0.955 "
     "at the stretch 1.1", "{intercept"),
    ("permittivity below that of vacuum", "permittivity: 3.0", "permittivity: 0.5",
     "14:28: materials.film.relative_permittivity: must be at least 1, not 0.5", "0.5"),
    ("no permittivity", "permittivity: 3.0", "permittivity: high",
     "14:28: materials.film.relative_permittivity: expected a number, not 'high'", "high"),
    ("negative modulus", "youngs_modulus: 1 MPa", "youngs_modulus: -1 MPa",
     "13:21: materials.film.youngs_modulus: must be above 0, not '-1 MPa'", "-1 MPa"),
    ("pre-stretch of three", "prestretch: 1.1", "prestretch: [1.1, 1.2, 1.3]",
     "15:17: materials.film.prestretch: expected a number such as 1.15, or two: [radial, hoop]",
     "[1.1"),
    ("pre-stretch of an unstable law", "law: neo_hookean\n    youngs_modulus: 1 MPa",
     "law: yeoh\n    c10: 1 kPa\n    c20: -1 MPa\n    bulk_modulus: 1 MPa",
     "17:17: materials.film.prestretch: yeoh with these parameters is unstable at this "
     "stretch: there is no thickness at which the transverse stress vanishes", "1.1"),
    ("pre-stretch", "prestretch: 1.1", "prestretch: 0.2",
     "15:17: materials.film.prestretch: must be at least 0.5, not 0.2", "0.2"),
    ("value for a section", "mesh:\n  columns: 8", "mesh: fine",
     "8:7: mesh: expected a mapping of keys, not 'fine'", "fine"),
    ("empty section", "mesh:\n  columns: 8", "mesh:",
     "8:1: mesh: expected a mapping of keys, not nothing", "mesh:"),
    ("name", "name: case", "name: my case",
     "1:7: name: use letters, digits, '_', '-', '.' and '+' only", "my case"),
    ("number for a name", "name: case", "name: 100",
     "1:7: name: expected text, not 100; put it in quotes: '100'", "100"),
    ("no stages", BASE[BASE.index("program"):], "program: []\n",
     "19:10: program: must not be empty", "[]"),
    ("a mapping for the program", BASE[BASE.index("  - {stage: prestrain}"):], "  stage: push\n",
     "20:3: program: expected a list, not a mapping", "stage: push"),
    # laws
    ("unknown material", "law: neo_hookean\n    youngs_modulus: 1 MPa", "library: elastosil",
     "12:14: materials.film.library: unknown material 'elastosil'; did you mean 'elastosil_2030'?",
     "elastosil"),
    ("a material of another law", "neo_hookean\n    youngs_modulus: 1 MPa",
     "gent\n    library: elastosil_2030",
     "12:10: materials.film.law: the law of elastosil_2030 is yeoh; leave out law, or library",
     "gent"),
    ("a material without permittivity",
     "law: neo_hookean\n    youngs_modulus: 1 MPa\n    relative_permittivity: 3.0",
     "library: deap_film",
     "11:3: materials.film.relative_permittivity: this key is missing; without it the film would "
     "be a conductor", "film:"),
    ("unknown law", "law: neo_hookean\n    youngs_modulus: 1", "law: neohookean\n    x: 1",
     "12:10: materials.film.law: unknown law 'neohookean'; did you mean 'neo_hookean'?",
     "neohookean"),
    ("no law", "    law: neo_hookean\n    youngs_modulus: 1 MPa\n", "",
     "12:5: materials.film: the key 'law' is missing; one of LAWS", "relative_permittivity"),
    ("a law's missing parameter", "youngs_modulus: 1 MPa", "shear_modulus: 1 MPa",
     "12:10: materials.film.law: neo_hookean needs bulk_modulus", "neo_hookean"),
    ("a law without parameters", "    youngs_modulus: 3 MPa\n", "",
     "17:10: materials.electrode.law: neo_hookean needs shear_modulus and bulk_modulus, or "
     "youngs_modulus alone", "neo_hookean"),
    ("modulus and parameters", "1 MPa", "1 MPa\n    shear_modulus: 1 MPa",
     "14:20: materials.film.shear_modulus: give either youngs_modulus or the law's own parameters",
     "1 MPa"),
    ("a law's parameter besides the modulus", "law: neo_hookean\n    youngs",
     "law: gent\n    youngs", "12:10: materials.film.law: gent needs j_lim besides youngs_modulus",
     "gent"),
    ("a locking law without parameters", "neo_hookean\n    youngs_modulus: 3 MPa", "arruda_boyce",
     "17:10: materials.electrode.law: arruda_boyce needs shear_modulus and locking_stretch and "
     "bulk_modulus, or youngs_modulus and locking_stretch", "arruda_boyce"),
    ("a modulus with its rule", "neo_hookean\n    youngs_modulus: 3 MPa",
     "yeoh\n    youngs_modulus: 3 MPa\n    c10: 1 MPa",
     "19:10: materials.electrode.c10: give either youngs_modulus or the law's own parameters",
     "1 MPa"),
    ("a locking stretch", "neo_hookean\n    youngs_modulus: 3 MPa",
     "arruda_boyce\n    youngs_modulus: 3 MPa\n    locking_stretch: 0.5",
     "19:22: materials.electrode.locking_stretch: must be above 1, not 0.5", "0.5"),
    ("a pre-stretch beyond locking", "law: neo_hookean\n    youngs_modulus: 1 MPa",
     "law: gent\n    j_lim: 0.1\n    youngs_modulus: 1 MPa",
     "16:17: materials.film.prestretch: gent reaches its limiting stretch before this one", "1.1"),
    ("Ogden's lists", "neo_hookean\n    youngs_modulus: 3 MPa",
     "ogden\n    mu: [1 MPa, 2 MPa]\n    alpha: 2\n    bulk_modulus: 50 MPa",
     "19:12: materials.electrode.alpha: 1 exponents for 2 moduli mu", "2"),
    ("Ogden's stiffness", "neo_hookean\n    youngs_modulus: 3 MPa",
     "ogden\n    mu: 1 MPa\n    alpha: -2\n    bulk_modulus: 50 MPa",
     "18:9: materials.electrode.mu: the sum of mu_i alpha_i must be positive: it is twice the "
     "shear modulus", "1 MPa"),
    ("unstable Mooney-Rivlin", "law: neo_hookean\n    youngs_modulus: 3 MPa",
     "law: mooney_rivlin\n    c10: 1 MPa\n    c01: -1 MPa\n    bulk_modulus: 50 MPa",
     "19:10: materials.electrode.c01: c10 + c01 must be positive: it is half the shear modulus at "
     "rest", "-1 MPa"),
    ("modulus in millipascal", "youngs_modulus: 1 MPa", "youngs_modulus: 1 mPa",
     "13:21: materials.film.youngs_modulus: a shear modulus of 3.333e-10 MPa is outside the "
     "range of solids (10 Pa to 10 TPa); check the unit: MPa is mega, mPa is milli", "1 mPa"),
    ("a law's modulus in millipascal", "neo_hookean\n    youngs_modulus: 3 MPa",
     "yeoh\n    c10: 1 mPa\n    bulk_modulus: 50 MPa",
     "18:10: materials.electrode.c10: a shear modulus of 2e-09 MPa is outside the range of "
     "solids (10 Pa to 10 TPa); check the unit: MPa is mega, mPa is milli", "1 mPa"),
    ("bulk modulus in petapascal", "neo_hookean\n    youngs_modulus: 3 MPa",
     "neo_hookean\n    shear_modulus: 1 MPa\n    bulk_modulus: 5 PPa",
     "19:19: materials.electrode.bulk_modulus: a bulk modulus of 5e+09 MPa is outside the "
     "range of solids (10 Pa to 10 TPa); check the unit: MPa is mega, mPa is milli", "5 PPa"),
    ("branch in millipascal", "    prestretch: 1.1",
     "    branches: [{shear_modulus: 20 mPa, relaxation_time: 1 s}]",
     "15:32: materials.film.branches.0.shear_modulus: a shear modulus of 2e-08 MPa is outside the "
     "range of solids (10 Pa to 10 TPa); check the unit: MPa is mega, mPa is milli", "20 mPa"),
    ("no electrode", "  electrode:\n    law: neo_hookean\n    youngs_modulus: 3 MPa\n", "",
     "10:1: materials.electrode: this key is missing, but geometry.electrode_thickness is above "
     "zero", "materials:"),
    # geometry
    ("outer below inner", "12 mm", "7 mm",
     "4:17: geometry.outer_radius: 7 mm must exceed inner_radius (8 mm)", "7 mm"),
    ("negative thickness", "30 um", "-30 um",
     "5:19: geometry.film_thickness: must be above 0, not '-30 um'", "-30 um"),
    ("clamps too wide", "air_height: 6 mm", "clamps: {width: 9 mm, height: 1 mm}",
     "7:19: geometry.clamps.width: 9 mm must be below inner_radius (8 mm)", "9 mm"),
    ("clamps too low", "air_height: 6 mm", "clamps: {width: 2 mm, height: 20 um}",
     "7:33: geometry.clamps.height: 0.02 mm must exceed half the strips' thickness (0.025 mm)",
     "20 um"),
    ("air inside the strips", "6 mm", "20 um",
     "7:15: geometry.air_height: 0.02 mm must exceed the solid below it (0.025 mm), or be 0 mm",
     "20 um"),
    ("air lower than the stroke", "6 mm", "2 mm",
     "7:15: geometry.air_height: 2 mm of air are too low for the displacement of 2 mm in stage "
     "'push'; use about twice the displacement", "2 mm"),
    ("air lower than a path", "terminal: {voltage: [0 V, 2 kV, 0 V]}, steps: 2}",
     "follow: {vary: force, until: {displacement: -7 mm}}}",
     "7:15: geometry.air_height: 6 mm of air are too low for the displacement of 7 mm in stage "
     "'actuate'; use about twice the displacement", "6 mm"),
    ("air lower than tables", "program:",
     "tables: {displacement: [1 mm, -6 mm], voltage: [0 V, 2 kV]}\nprogram:",
     "7:15: geometry.air_height: 6 mm of air are too low for the displacement of 6 mm in tables; "
     "use about twice the displacement", "6 mm"),
    # moduli
    ("modulus below zero", "youngs_modulus: 3 MPa", "youngs_modulus: -3 MPa",
     "18:21: materials.electrode.youngs_modulus: must be above 0, not '-3 MPa'", "-3 MPa"),
    ("exponent of zero", "law: neo_hookean\n    youngs_modulus: 3 MPa",
     "law: ogden\n    youngs_modulus: 3 MPa\n    alpha: [0]",
     "19:12: materials.electrode.alpha: an exponent must not be 0", "[0]"),
    # tables
    ("tables of one voltage", "program:",
     "tables: {displacement: [0 mm, -1 mm], voltage: [2 kV, 2 kV]}\nprogram:",
     "19:48: tables.voltage: the first and the last value must differ", "[2 kV"),
    ("tables of one end", "program:",
     "tables: {displacement: [0 mm], voltage: [0 V, 2 kV], points: [3, 3, 3]}\nprogram:",
     "19:24: tables.displacement: too few items", "[0 mm]"),
    ("tables of three numbers", "program:",
     "tables: {displacement: [0 mm, 1 mm], voltage: [0 V, 2 kV], points: [3, 3, 3]}\nprogram:",
     "19:68: tables.points: expected a number for each of displacement, voltage, not 3 numbers",
     "[3"),
    ("tables of four numbers", "program:",
     "tables: {displacement: [0 mm, 1 mm], voltage: [0 V, 2 kV], points: [3, 3, 3, 3]}\nprogram:",
     "19:68: tables.points: expected at most 3 items, not 4", "[3"),
    ("tables of a word", "program:",
     "tables: {displacement: wide, voltage: [0 V, 2 kV]}\nprogram:",
     ["19:24: tables.displacement: expected a list, not 'wide'",
      "19:24: tables.displacement: expected a mapping of keys, not 'wide'"], "wide"),
    ("tables of a port without a unit", "program:",
     "tables: {displacement: [0 mm, 1 mm], voltage: {top: [0, 2 kV]}}\nprogram:",
     "19:54: tables.voltage.top.0: expected a voltage with its unit, such as '2.5 kV'; '0' has no "
     "unit", "0,"),
    ("tables of a softening film", "materials:\n  film:\n",
     "tables: {displacement: [0 mm, 1 mm], voltage: [0 V, 2 kV]}\nmaterials:\n  film:\n"
     "    mullins: {r: 2, m: 10 kPa}\n",
     "10:9: tables: materials.film has mullins: tables cannot hold forces that "
     "depend on the load history", "{displacement"),
    ("tables without a potential", "program:",
     "physics: {coupling: pelrine}\n"
     "tables: {displacement: [0 mm, 1 mm], voltage: [0 V, 2 kV]}\nprogram:",
     "19:21: physics.coupling: tables need coupling: energy", "pelrine"),
    ("tables of two points", "program:",
     "tables: {displacement: [0 mm, 1 mm], voltage: [0 V, 2 kV], points: [9, 2]}\nprogram:",
     "19:72: tables.points.1: must be at least 3, not 2", "2]"),
    # program
    ("pre-strain not first", "{stage: prestrain}", "{stage: hold}\n  - {stage: prestrain}",
     "21:13: program.1.stage: prestrain can only be the first stage", "prestrain"),
    ("pre-strain with an input", "{stage: prestrain}", "{stage: prestrain, mount: {force: 0 N}}",
     "20:31: program.0.mount: a prestrain stage takes no input", "{force"),
    ("a negative mass", "displacement: -2 mm", "mass: -30 g",
     "21:33: program.1.mount.mass: a mass is positive; a pull upwards is a positive force",
     "-30 g"),
    ("a negative mass beside others", "displacement: -2 mm", "bias: [{mass: [0 g, -30 g]}]",
     "21:47: program.1.mount.bias.0.mass.1: a mass is positive; a pull upwards is a positive "
     "force", "-30 g"),
    ("a positive negative rate", "displacement: -2 mm",
     "bias: [{bistable: {rate: 1 N/mm, well: 1 mm, anchor: 0 mm}}]",
     "21:52: program.1.mount.bias.0.bistable.rate: must be below 0, not '1 N/mm'", "1 N/mm"),
    ("a force without a unit", "displacement: -2 mm", "force: -0.3",
     "21:34: program.1.mount.force: expected a force with its unit, such as '-0.3 N'; '-0.3' has "
     "no unit", "-0.3"),
    ("a mass in newton", "displacement: -2 mm", "mass: 0.3 N",
     "21:33: program.1.mount.mass: expected a mass with its unit, such as '20 g'; 'N' is not a "
     "unit of that kind", "0.3 N"),
    ("an unknown unit at a port", "[0 V, 2 kV, 0 V]", "2.5 KV",
     "22:42: program.2.terminal.voltage: expected a voltage with its unit, such as '2.5 kV'; 'KV' "
     "is no unit; did you mean 'kV'?", "2.5 KV"),
    ("an empty polyline", "[0 V, 2 kV, 0 V]", "[]",
     "22:42: program.2.terminal.voltage: must not be empty", "[]"),
    ("a table of a single force", "displacement: -2 mm",
     "bias: [{table: {displacement: [0 mm, 1 mm], force: [1 N], anchor: 0 mm}}]",
     "21:78: program.1.mount.bias.0.table.force: expected at least 2 items, not 1", "[1 N]"),
    ("two inputs at a port", "{displacement: -2 mm}", "{displacement: -2 mm, force: 0 N}",
     "21:55: program.1.mount.force: displacement and force exclude each other; give one", "0 N"),
    ("no input at a port", "{displacement: -2 mm}", "{}",
     "21:26: program.1.mount: give one of displacement, force, mass, spring, bias", "{}"),
    ("cycles of one value", "-2 mm}", "-2 mm}, cycles: 3",
     "21:41: program.1.mount.displacement: 3 cycles need a list, such as [0, peak, 0] with units",
     "-2 mm"),
    ("cycles that do not close", "2 kV, 0 V]}", "2 kV]}, cycles: 2",
     "22:42: program.2.terminal.voltage: 2 cycles need a list that ends where it begins", "[0 V"),
    ("cycles of nothing", "{stage: prestrain}", "{stage: prestrain, cycles: 2}",
     "20:32: program.0.cycles: cycles repeat an input of the stage; this one has none", "2}"),
    ("negative duration", "{stage: push,", "{stage: push, duration: -1 s,",
     "21:29: program.1.duration: must be above 0, not '-1 s'", "-1 s"),
    ("no mesh file", "columns: 8", "file: none.msh",
     "9:9: mesh.file: there is no file 'none.msh' in the present folder", "none.msh"),
    # conditions and limits
    ("no condition", "-2 mm}, steps: 2", "-2 mm}, steps: 2, stop_when: [force_N]",
     "21:71: program.1.stop_when.0: 'force_N' is not a condition; expected a column of "
     "history.csv, one of <, <=, >, >= and a value, such as 'field_max_MV_per_m > 80 MV/m'",
     "force_N"),
    ("unknown column", "-2 mm}, steps: 2", "-2 mm}, steps: 2, stop_when: [forceN < -1 N]",
     "21:71: program.1.stop_when.0: unknown column 'forceN'; did you mean 'force_N'?",
     "forceN"),
    ("condition without a unit", "-2 mm}, steps: 2", "-2 mm}, steps: 2, stop_when: [force_N < -1]",
     "21:71: program.1.stop_when.0: '-1' has no unit; force_N is in N", "force_N"),
    ("condition with a wrong unit", "program:", "stop_when:\n  - when: force_N < -1 mm\nprogram:",
     "20:5: stop_when.0: expected a unit such as 'N'; 'mm' is not a unit of that kind",
     "when: force_N"),
    ("condition with a needless unit", "program:", "stop_when: [stretch_max > 2 mm]\nprogram:",
     "19:13: stop_when.0: stretch_max is a plain number, '2 mm' has a unit", "stretch_max"),
    ("misspelt key of a condition", "program:",
     "stop_when: [{when: force_N < -1 N, bisekt: 3}]\nprogram:",
     "19:36: stop_when.0.bisekt: unknown key; did you mean 'bisect'?", "bisekt"),
    ("condition on a limit that is not set", "program:",
     "stop_when: [breakdown_use > 1]\nprogram:",
     "19:13: stop_when.0: breakdown_use needs limits.breakdown_strength", "breakdown_use"),
    *((f"condition on {column}", "-2 mm}, steps: 2", f"-2 mm}}, stop_when: [{column} > {value}]",
       f"21:61: program.1.stop_when.0: {column} needs {need}", column)
      for column, value, need in (
          ("stretch_use", "1", "limits.stretch_max"),
          ("stability_use", "1", "a film that can lose its stiffness, such as mooney_rivlin with "
           "c01 below 0"),
          ("locking_use", "0.9", "a film whose law locks: gent or arruda_boyce"),
          ("differential_capacitance_pF", "1 pF", "sensing.differential: true"),
          ("blocked_capacitance_pF", "1 pF", "sensing.differential: true"),
          ("mount_stiffness_N_per_mm", "1 N/mm", "sensing.differential: true"),
          *((column, value, "sensing.sheet_resistance, of a laminate in two dimensions with one "
             "terminal")
            for column, value in (("electrode_resistance_kohm", "1 kohm"), ("rc_time_us", "1 us"))),
          ("dissipated_energy_mJ", "1 mJ", "a material with branches, mullins or permanent_set"),
          ("dissipated_power_mW", "1 mW", "Maxwell branches, such as materials.film.branches"),
          ("unstable_modes", "0", "output.modes above 0, or a stage with follow"),
          ("limit_point", "0", "a stage with follow"),
          ("bifurcation", "0", "a stage with follow"))),
    ("condition of the pre-strain", "{stage: prestrain}",
     "{stage: prestrain, stop_when: [force_N < -1 N]}",
     "20:35: program.0.stop_when: a prestrain stage cannot be stopped early", "["),
    ("knock-down of nothing", "program:", "limits: {electrode_knockdown: 0.8}\nprogram:",
     "19:31: limits.electrode_knockdown: needs breakdown_strength, which it reduces", "0.8"),
    # YAML
    ("tab", "  columns", "\tcolumns", "9:1: a tab; YAML takes spaces only", None),
    ("indentation", "  outer_radius", " outer_radius",
     "4:2: the indentation of this line matches no line above", "outer_radius"),
    ("open bracket", "0 V]}, steps: 2}", "0 V}, steps: 2}",
     "22:57: a ',' or the closing ']' is missing before this", "}"),
    ("open quote", "name: case", "name: 'case", "23:1: a closing quote is missing", None),
    ("colon in text", "name: case", "name: a: b",
     "1:8: a ':' in the wrong place; check the indentation, or put the text in quotes", ": b"),
    ("wrong tag", "columns: 8", "columns: !fine 8",
     "9:12: mesh.columns: unknown tag '!fine'; write the value alone", "!fine"),
    ("undefined alias", "12 mm", "*r", "4:17: '*r' refers to no anchor '&r'", "*r"),
    ("second document", "mesh:", "---\nmesh:",
     "8:1: a second document begins here; a file holds one", "---"),
    ("control character", "name: case", "name: \x07",
     "1:7: a control character, which YAML does not allow", None),
]  # fmt: skip

# (what, text of the whole file, message without the file name)
FILES = [
    ("empty file", "", ": the file is empty; 'dealib init' writes a config to start from"),
    ("only comments", "# a\n", ": the file is empty; 'dealib init' writes a config to start from"),
    ("list", "- a\n- b\n", ":1:1: expected keys such as 'geometry:', not a list\n    - a\n    ^"),
    ("text", "hello", ":1:1: expected keys such as 'geometry:', not plain text\n    hello\n    ^"),
    ("no text", b"\xff\xfe\x00", ": not a text file in UTF-8"),
]

# (assignment, message)
SETS = [
    ("mesh.colums=80", "unknown key; did you mean 'columns'?"),
    ("meshh.columns=80", "meshh: unknown key; did you mean 'mesh'?"),
    ("materials.film.e=1 MPa", "unknown key; known: KEYS"),
    ("program.9.steps=2", "program is a list with items 0 to 2, it has no 9"),
    ("program.push.steps=2", "program is a list with items 0 to 2, it has no 'push'"),
    ("geometry.inner_radius.x=2", "geometry.inner_radius is a single value without a key 'x'"),
    ("0.steps=2", "the file is not a list"),
    ("mesh.columns", "expected KEY=VALUE, such as mesh.columns=80"),
    ("=3", "expected KEY=VALUE, such as mesh.columns=80"),
    ("mesh.columns=7", "must be a multiple of 2, not 7"),
    ("mesh=3", "expected a mapping of keys, not 3"),
    ("geometry.outer_radius=7 mm", "7 mm must exceed inner_radius (8 mm)"),
    ("geometry.outer_radius=7",
     "expected a length with its unit, such as '30 um'; '7' has no unit"),
    ("geometry={inner_radius: 1 mm}", [
        "geometry.outer_radius: this key is missing: inner radius of the rigid frame; such as "
        "'30 um'",
        "geometry.film_thickness: this key is missing: thickness as mounted, that is "
        "pre-stretched; such as '30 um'",
        "geometry.electrode_thickness: this key is missing: 0 um: no electrode bodies, the film's "
        "faces are the electrodes; such as '30 um'"]),
]  # fmt: skip

# (arguments, message)
USAGE = [
    (["chek", "x"], "no such command 'chek'; did you mean 'check', 'schema' (see: dealib --help)"),
    (["check"], "missing argument 'CONFIG' (see: dealib check --help)"),
    (["check", "x", "--st"], "no such option: --st; did you mean --set (see: dealib check --help)"),
    (["run", "x", "--mpi", "0"], "--mpi: must be at least 1, not '0' (see: dealib run --help)"),
    (["run", "x", "--mpi", "a"],
     "--mpi: expected a whole number, not 'a' (see: dealib run --help)"),
    (["check", "a", "b"], "got unexpected extra argument(s) (b) (see: dealib check --help)"),
    (["run", "x", "--set"], "option '--set' requires an argument (see: dealib run --help)"),
    (["plot", "x", "--out"], "option '--out' requires an argument (see: dealib plot --help)"),
    (["--foo"], "no such option: --foo (see: dealib --help)"),
    (["check", "none.yaml"], "none.yaml: cannot read the config: No such file or directory"),
    (["check", "."], ".: cannot read the config: Is a directory"),
    (["info", "."], ".: no run here (there is no run.json)"),
    (["init", "--template", "deep"], "--template deep: unknown; did you mean 'deap'?"),
    (["init", "--out", "no/x.yaml"], "no/x.yaml: there is no folder no"),
    (["mesh", str(ROOT / "configs/membrane.yaml"), "--out", "x.vtk"],
     "--out x.vtk: the name must end in .msh"),
]  # fmt: skip


@pytest.fixture
def dealib(tmp_path, monkeypatch, capsys):
    """Runs a command in an empty directory; returns its exit code, stdout and stderr."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["dealib", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        return (stop.value.code, *capsys.readouterr())

    monkeypatch.chdir(tmp_path)
    return call


def law_names():
    from dealib.materials.laws import LAWS

    return ", ".join(LAWS)


@pytest.mark.parametrize(("old", "new", "expected", "at"), [e[1:] for e in EDITS],
                         ids=[e[0] for e in EDITS])  # fmt: skip
def test_bad_config(dealib, tmp_path, old, new, expected, at):
    text = BASE.replace(old, new, 1)
    assert text != BASE
    path = tmp_path / "case.yaml"
    path.write_text(text)
    code, out, err = dealib("check", path)
    assert (code, out) == (2, "")
    shown = err.removeprefix("dealib: ").splitlines()
    heads = [line for line in shown if line.startswith(str(path))]
    expected = [expected] if isinstance(expected, str) else expected
    expected = [e.replace("LAWS", law_names()).replace("TMP", str(tmp_path)) for e in expected]
    assert [h.removeprefix(f"{path}:") for h in heads] == expected
    if at is not None:  # the line and the caret under what is wrong
        line, caret = shown[-2:]
        assert line[caret.index("^") :].startswith(at)
        assert caret.strip() == "^"


@pytest.mark.parametrize(("text", "expected"), [f[1:] for f in FILES], ids=[f[0] for f in FILES])
def test_bad_file(dealib, tmp_path, text, expected):
    path = tmp_path / "case.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert dealib("check", path) == (2, "", f"dealib: {path}{expected}\n")


@pytest.mark.parametrize(("assignment", "expected"), SETS, ids=[s[0] for s in SETS])
def test_bad_override(dealib, tmp_path, assignment, expected):
    path = tmp_path / "case.yaml"
    path.write_text(BASE)
    keys = "youngs_modulus, law, shear_modulus, bulk_modulus"
    expected = [expected] if isinstance(expected, str) else expected
    said = "\n".join(f"--set {assignment}: {e}" for e in expected)
    code, out, err = dealib("check", path, "--set", assignment)
    known = (
        "library, relative_permittivity, density, prestretch, mounted, branches, mullins, "
        "permanent_set, "
    )
    assert (code, out) == (2, "")
    assert err == f"dealib: {said}\n".replace("KEYS", known + keys)


def test_overrides_are_named_where_the_place_is_in_the_file(dealib, tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text(BASE)
    _, _, err = dealib("check", path, "--set", "geometry.inner_radius=15 mm")
    said = "geometry.outer_radius: 12 mm must exceed inner_radius (15 mm)"
    said += " (with --set geometry.inner_radius=15 mm)\n"
    assert err.startswith(f"dealib: {path}:4:17: {said}")
    steps = ["--set", "mesh.columns=20", "--set", "program.1.steps=10000000"]
    code, _, err = dealib("check", path, *steps)
    named = "(with --set mesh.columns=20, --set program.1.steps=10000000)"
    assert code == 2
    assert err.splitlines()[0].endswith(named)
    assert err.startswith(f"dealib: {path}:19:1: program: at most 1,000,000 steps")


@pytest.mark.parametrize(("arguments", "expected"), USAGE, ids=[" ".join(u[0]) for u in USAGE])
def test_bad_usage(dealib, tmp_path, arguments, expected):
    assert dealib(*arguments) == (2, "", f"dealib: {expected}\n")
    assert list(tmp_path.iterdir()) == []


def test_messages_speak_plainly(dealib, tmp_path):
    """No phrase of pydantic, no type name of Python, however wrong a value is."""
    path = tmp_path / "case.yaml"
    seen = 0
    for line in BASE.splitlines():
        key, _, value = line.partition(": ")
        if not value:
            continue
        for wrong in ("{a: {b: 1}}", "[[1, 2], x]", "true", "", "-1e3", "'\\u00e9'", "2020-01-01"):
            path.write_text(BASE.replace(line, f"{key}: {wrong}", 1))
            code, _, err = dealib("check", path)
            if code == 0:
                continue
            seen += 1
            assert code == 2
            for phrase in (
                "nput should",
                "a valid",
                "Value error",
                "NoneType",
                "dict",
                "Traceback",
            ):
                assert phrase not in err, err
            assert all(len(line) < 250 for line in err.splitlines())
    assert seen > 60


# --- files and directories that must stay as they are --------------------------------------------


def snapshot(directory):
    return {p: p.read_bytes() for p in sorted(directory.rglob("*")) if p.is_file()}


def test_existing_output_is_left_alone(dealib, tmp_path):
    (tmp_path / "case.yaml").write_text(BASE)
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("precious")
    before = snapshot(tmp_path)
    run = ("run", "case.yaml", "--out", "out")
    said = "dealib: out exists and is not empty; choose another --out, --overwrite it, or "
    said += "--resume it if it is an unfinished run\n"
    assert dealib(*run) == (2, "", said)
    said = "dealib: out is no run directory of dealib; it is not overwritten\n"
    assert dealib(*run, "--overwrite") == (2, "", said)
    assert snapshot(tmp_path) == before


def test_init_and_schema_overwrite_nothing(dealib, tmp_path):
    (tmp_path / "deap.yaml").write_text("precious")
    said = "dealib: deap.yaml exists and is left as it is; choose another --out\n"
    assert dealib("init") == (2, "", said)
    assert dealib("schema", "--out", "deap.yaml") == (2, "", said)
    assert snapshot(tmp_path) == {tmp_path / "deap.yaml": b"precious"}


def test_broken_run_directory(dealib, tmp_path):
    (tmp_path / "run.json").write_text('{"name": "x", ')
    said = "dealib: run.json: damaged (not readable as JSON); there are no results either\n"
    assert dealib("info", ".") == (2, "", said)


CLAMPS = "  clamps: {width: 2 mm, height: 1.5 mm}\n"
DEVICE = BASE.replace("mesh:\n", CLAMPS + "mesh:\n")  # with all regions

GMSH = """\
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "rubber"
$EndPhysicalNames
$Nodes
4
1 8 -1 0
2 12 -1 0
3 12 1 0
4 8 1 0
$EndNodes
$Elements
1
1 3 2 1 1 1 2 3 4
$EndElements
"""


def mixed(text):
    """A triangle beside the first quadrilateral of a Gmsh 4.1 file."""
    blocks = re.search(r"\$Elements\n(\d+) (\d+) (\d+) (\d+)\n", text)
    n, cells, first, last = map(int, blocks.groups())
    block = re.search(r"^2 (\d+) 3 \d+\n\d+ (\d+) (\d+) (\d+) \d+ *\n", text, re.M)
    extra = f"2 {block[1]} 2 1\n{last + 1} {block[2]} {block[3]} {block[4]}\n"
    head = f"$Elements\n{n + 1} {cells + 1} {first} {last + 1}\n"
    text = text.replace(blocks[0], head)
    return text.replace("$EndElements", extra + "$EndElements")


# (what, change of the mesh's text, texts in the config and their replacements, message)
MESHES = [
    ("no mesh", lambda good: "hello", {},
     "no mesh of Gmsh's, which begins with $MeshFormat\n"),
    ("without the names", lambda good: GMSH, {},
     "no physical group named film, top_electrode, bottom_electrode, mount_block, frame_block, "
     "air, inner, outer, film_top, film_bottom, axis_air, outer_air, top_air, bottom_air; the "
     "geometry of the config asks for them, the file has: rubber\n"),
    ("another name", lambda good: good.replace('"mount_block"', '"centre"'), {CLAMPS: ""},
     "it has a surface 'centre'; known are film, top_electrode, bottom_electrode, air, "
     "mount_block, frame_block\n"),
    ("mixed cells", mixed, {},
     "all cells must be 4-node quadrilaterals, or all 3-node triangles\n"),
    ("another extent", str, {"12 mm": "13 mm"},
     "the film spans R = 8..12, Z = -0.015..0.015 mm, but the geometry of the config says "
     "R = 8..13, Z = -0.015..0.015 mm\n"),
    ("thinner electrodes", str, {"10 um": "20 um"},
     "top_electrode ends at Z = 0.025 mm, but geometry.electrode_thickness of the config says "
     "Z = 0.035 mm\n"),
    ("electrodes for none", str, {"10 um": "0 um"},
     "it has 'bottom_electrode', but geometry.electrode_thickness says that there is none\n"),
    ("air for none", str, {"  air_height: 6 mm\n": ""},
     "it has 'air', but geometry.air_height says that there is none\n"),
    ("higher air", str, {"6 mm": "5 mm"},
     "air ends at Z = -6 mm, but geometry.air_height of the config says Z = -5 mm\n"),
    ("clamps for none", str, {CLAMPS: ""},
     "it has 'mount_block', but geometry.clamps says that there is none\n"),
    ("wider clamps", str, {"width: 2 mm": "width: 1 mm"},
     "mount_block ends at R = 6 mm, but geometry.clamps.width of the config says R = 7 mm\n"),
    ("higher clamps", str, {"height: 1.5 mm": "height: 1 mm"},
     "mount_block ends at Z = -1.5 mm, but geometry.clamps.height of the config says Z = -1 mm\n"),
]  # fmt: skip


@pytest.fixture(scope="module")
def good_mesh(tmp_path_factory):
    """Text of a mesh that fits DEVICE."""
    from dealib.config import load
    from dealib.device import gmsh_model

    folder = tmp_path_factory.mktemp("mesh")
    (folder / "case.yaml").write_text(DEVICE)
    gmsh_model.write(load(folder / "case.yaml").config, folder / "good.msh")
    return (folder / "good.msh").read_text()


@pytest.mark.parametrize(("change", "edits", "expected"), [m[1:] for m in MESHES],
                         ids=[m[0] for m in MESHES])  # fmt: skip
def test_bad_mesh_file(dealib, tmp_path, good_mesh, change, edits, expected):
    text = DEVICE.replace("columns: 8", "file: mine.msh")
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "case.yaml").write_text(text)
    (tmp_path / "mine.msh").write_text(change(good_mesh))
    old = tmp_path / "out"
    old.mkdir()
    (old / "run.json").write_text(json.dumps({"name": "an earlier run"}))
    before = snapshot(tmp_path)
    code, _, err = dealib("run", "case.yaml", "--out", "out", "--overwrite")
    assert code == 2
    assert err.startswith(f"dealib: mine.msh: {expected}")
    assert len(err.splitlines()) == 1
    assert snapshot(tmp_path) == before


def test_home_is_the_users(dealib, tmp_path, monkeypatch):
    """Where the shell has left a '~' as it is: in quotes, after '=', in a config."""
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    (tmp_path / "case.yaml").write_text((ROOT / "tests" / "small.yaml").read_text())
    short = ["--set", "program.0.steps=1", "--set", "program.1.steps=2"]
    run = ["run", "case.yaml", *short]
    assert dealib(*run, "--set", "output.directory=~/a")[0] == 0
    assert dealib(*run, "--out", "~/b")[0] == 0
    assert dealib("mesh", "case.yaml", "--out=~/c.msh")[:2] == (
        0,
        f"{home}/c.msh: 8 cells (film 8)\n",
    )
    assert dealib(*run, "--set", "mesh.file=~/c.msh", "--out", "~/d")[0] == 0
    assert sorted(p.name for p in home.glob("[a-z]*")) == ["a", "b", "c.msh", "d"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.yaml", "home"]


# --- the same from outside -----------------------------------------------------------------------


def command(*arguments, cwd, env=None):
    return subprocess.run(
        [sys.executable, "-m", "dealib", *map(str, arguments)],
        cwd=cwd, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | (env or {}),
    )  # fmt: skip


@pytest.mark.parametrize("arguments", [
    ["check", "case.yaml"], ["run", "case.yaml"], ["run", "case.yaml", "--foo"], ["fly"],
    ["run", "no.yaml"], ["mesh", "case.yaml", "--set", "mesh"], ["info", "nowhere"],
])  # fmt: skip
def test_from_outside(tmp_path, arguments):
    (tmp_path / "case.yaml").write_text(BASE.replace("12 mm", "7 mm"))
    done = command(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said(done.stderr).startswith("dealib: ")
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["case.yaml"]


def test_unreadable_file(tmp_path, monkeypatch):
    path = tmp_path / "case.yaml"
    path.write_text(BASE)

    def refuse(given, *args, **kwargs):  # root, who may run this, reads files of any mode
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(given))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: cannot read the config: Permission denied"
    assert caught.value.exit_code == 2


def test_light_commands_import_nothing_heavy():
    """`check`, `schema` and `--help` import no dolfinx, pandas, matplotlib, and are quick.

    The yardstick is the processor's time that the libraries take which they need: about 0.4 s on a
    quiet machine, and twice that on one that runs two tests.
    """
    heavy = {
        "dolfinx", "petsc4py", "mpi4py", "pandas", "matplotlib", "pyvista", "vtk", "gmsh", "lmfit",
        "h5py",
    }  # fmt: skip

    def seconds(code: str, *arguments: str) -> float:
        code += (
            "\nimport sys, time\n"
            f"print(time.process_time(), {heavy} & set(sys.modules), file=sys.stderr)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=ROOT, capture_output=True, text=True, check=True,
        )  # fmt: skip
        taken, seen = done.stderr.split(maxsplit=1)
        assert seen.strip() == "set()"
        return float(taken)

    limits = {("check", "configs/deap100.yaml"): 2.0, ("schema",): 2.2, ("--help",): 0.7}
    ratios = dict.fromkeys(limits, math.inf)
    for _ in range(8):  # the least counts: others share the processor's caches
        if all(ratio < limits[arguments] for arguments, ratio in ratios.items()):
            break
        libraries = seconds("import numpy, pint, pydantic, ruamel.yaml, typer")
        for arguments in limits:
            taken = seconds(
                "from dealib.__main__ import main\n"
                "try: main()\nexcept SystemExit as stop: assert not stop.code",
                *arguments,
            )
            ratios[arguments] = min(ratios[arguments], taken / libraries)
    assert all(ratio < limits[arguments] for arguments, ratio in ratios.items()), ratios


def test_typographic_minus_is_a_minus(tmp_path):
    (tmp_path / "case.yaml").write_text(BASE.replace("-2 mm", "\u22122e\u22123 m"))
    assert load(tmp_path / "case.yaml").config.program[1].mount.displacement == (-2.0,)


def test_usual_units_are_those_of_pint():
    from dealib.units import USUAL, _registry

    for unit, factors in USUAL.items():
        for given, factor in factors.items():
            theirs = given.replace("m3", "m^3")
            assert factor == pytest.approx(_registry()(f"1 {theirs}").to(unit).magnitude, rel=1e-15)

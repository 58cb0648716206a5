"""Inputs of a stage: polylines, cycles, milestones."""

import pytest

from dealib.config.inputs import MountInput, TerminalInput
from dealib.config.program import Stage
from dealib.device.records import MOUNT, TERMINAL, Port
from dealib.program.inputs import Drive, drives, milestones

pytestmark = pytest.mark.once  # arithmetic of configs
PLATE, ELECTRODE = Port(MOUNT, "mount", ("inner",)), Port(TERMINAL, "terminal", ("film_top",))


def drive(*knots):
    return Drive("terminal.voltage", "kV", "value", knots)


def test_a_polyline_is_repeated():
    voltage = drive(0.0, 2.0, 0.0)
    assert [voltage.at(t) for t in (0, 0.25, 0.5, 1, 1.5, 1.75, 2)] == [0, 1, 2, 0, 2, 1, 0]


def test_only_the_first_cycle_comes_from_elsewhere():
    """From 1 kV to the list [0, 2, 0]: the way to its beginning is made once."""
    voltage = drive(1.0, 0.0, 2.0, 0.0)
    assert [voltage.at(k / 3) for k in range(4)] == pytest.approx([1, 0, 2, 0])
    assert [voltage.at(1 + k / 2) for k in range(3)] == pytest.approx([0, 2, 0])


def test_milestones_hold_the_grid_and_every_corner():
    stage = Stage(stage="s", duration="1 s", steps=4, cycles=2, terminal={"voltage": ["0 kV"] * 2})
    targets, corners = milestones(stage, [drive(1.0, 0.0, 2.0, 0.0)])
    assert corners == {1 / 3, 2 / 3, 1.0, 1.5, 2.0}
    assert set(targets) == corners | {0.25, 0.5, 0.75, 1.25, 1.75}
    assert targets == sorted(targets)


@pytest.mark.parametrize(
    "given",
    [
        {"force": ["-0.3 N", "-0.4 N", "-0.3 N"]},
        {"mass": ["10 g", "20 g", "10 g"]},
        {"spring": {"stiffness": "0.2 N/mm", "anchor": ["-3 mm", "-4 mm", "-3 mm"]}},
    ],
)
def test_a_list_begins_where_the_mount_was_put_not_where_it_was_found(given):
    """The solver meets a force to its tolerance; a list from there would lose a third of its time.

    There are three knots, not a fourth for a way of 1e-8 N.
    """
    mount = MountInput.model_validate(given)
    there = drives(PLATE, mount, -1.0, -0.2)
    (found,) = drives(PLATE, mount, -1.0, there[0].knots[-1] + 1e-8, there)
    assert len(found.knots) == 3
    assert found.knots == there[0].knots[-3:]


def test_a_list_of_charges_begins_where_the_terminal_was_put():
    given = TerminalInput.model_validate({"charge": ["0.1 uC", "0.2 uC", "0.1 uC"]})
    there = drives(ELECTRODE, given, 0.0, 0.0)
    (found,) = drives(ELECTRODE, given, 0.6, 0.1 + 1e-9, there)
    assert found.knots == (0.1, 0.2, 0.1)

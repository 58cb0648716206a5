"""Inputs of a stage: polylines, cycles, milestones."""

import pytest

from dealib.config.program import Stage
from dealib.program.inputs import Drive, milestones


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
    assert corners == {round(1 / 3, 12), round(2 / 3, 12), 1.0, 1.5, 2.0}
    assert set(targets) == corners | {0.25, 0.5, 0.75, 1.25, 1.75}
    assert targets == sorted(targets)

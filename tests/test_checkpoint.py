"""A checkpoint holds what its run has written, or the run is not resumed from it."""

import json

import h5py
import numpy as np
import pytest
from conftest import CONFIGS

import dealib
from dealib.errors import ConfigError
from dealib.results.checkpoint import CheckpointFolder, history_sum
from dealib.results.rows import Stream, Transferred

pytestmark = pytest.mark.once  # files
VISCOUS = CONFIGS.parent / "tests" / "viscous.yaml"


class Enough(Exception):
    """Ends a run as a kill would."""


class Stop:
    """Ends a run after a step."""

    def __init__(self, step):
        self.step = step

    def start(self, simulation):
        pass

    def see(self, state):
        if state.row["step"] == self.step:
            raise Enough

    def stop(self, error):
        pass


@pytest.fixture
def stopped(tmp_path):
    """A viscous run that ended in the middle, after its sixth step."""
    with pytest.raises(Enough):
        dealib.simulate(VISCOUS, tmp_path / "run", observers=[Stop(6)])
    return tmp_path / "run"


def resume(path):
    return dealib.simulate(VISCOUS, path, resume=True)


def scaled(path):
    np.save(path, np.load(path) * 1.02)


def flipped(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def emptied(path):
    path.write_bytes(b"")


def test_an_array_that_comes_in_parts_is_stored_as_a_whole_one(tmp_path):
    array = np.random.default_rng(1).normal(size=(7, 3, 2))
    parts = Stream(array.shape, iter([array[:4], array[4:4], array[4:]]))
    stored = CheckpointFolder(tmp_path).keep("parts", 3, parts)
    np.save(tmp_path / "whole.npy", array)
    assert stored.path.read_bytes() == (tmp_path / "whole.npy").read_bytes()
    assert stored.shape == array.shape
    weights = np.array([[0.5, 0.25, 0.25], [0.0, 1.0, 0.0]])
    other = Transferred(stored, weights)
    assert other.shape == (7, 2, 2)
    assert other[[5, 1]] == pytest.approx(weights @ array[[5, 1]], abs=1e-15)


DAMAGED = "damaged checkpoint ({} is not what the run has written)"


@pytest.mark.parametrize("change", [scaled, flipped, emptied])
@pytest.mark.parametrize("name", ["internal_00006.npy", "state_00006.npy", "state_00004.npy"])
def test_arrays_that_have_changed_are_refused(stopped, name, change):
    change(stopped / "checkpoint" / name)
    with pytest.raises(ConfigError) as caught:
        resume(stopped)
    assert caught.value.exit_code == 2
    assert str(caught.value) == (
        f"{stopped}/checkpoint: {DAMAGED.format(name)}; start anew with overwrite=True"
    )


@pytest.mark.parametrize("name", ["internal_00006.npy", "state_00006.npy", "state_00005.npy"])
def test_arrays_that_are_missing_are_told(stopped, name):
    (stopped / "checkpoint" / name).unlink()
    with pytest.raises(ConfigError, match=rf"damaged checkpoint \(.*{name}"):
        resume(stopped)


def test_values_that_have_changed_are_refused(stopped):
    file = stopped / "checkpoint/program.json"
    found = json.loads(file.read_text())
    found["values"]["progress"]["time"] *= 1.02
    file.write_text(json.dumps(found))
    with pytest.raises(ConfigError, match=r"program\.json is not what the run has written"):
        resume(stopped)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"values": 3}', "[" * 100_000])
def test_values_that_are_no_checkpoint_are_refused(stopped, text):
    (stopped / "checkpoint/program.json").write_text(text)
    with pytest.raises(ConfigError, match="damaged checkpoint"):
        resume(stopped)


def test_a_history_that_has_changed_is_refused(stopped):
    file = stopped / "history.csv"
    header, *rows = file.read_text().splitlines()
    cells = rows[3].split(",")
    place = header.split(",").index("force_N")
    cells[place] = repr(float(cells[place]) * 1.02)
    rows[3] = ",".join(cells)
    file.write_text("\n".join([header, *rows]) + "\n")
    with pytest.raises(ConfigError) as caught:
        resume(stopped)
    assert str(caught.value) == (
        f"{stopped}: cannot resume, history.csv is not what the run has written; it is restored "
        "if you remove it; start anew with overwrite=True"
    )
    file.unlink()
    assert resume(stopped).status == "done"


def test_a_history_in_the_results_that_has_changed_is_refused(stopped):
    with h5py.File(stopped / "results.h5", "r+") as file:
        file["history/force_N"][2] *= 1.02
    with pytest.raises(ConfigError, match=r"results\.h5 is not what the run has written"):
        resume(stopped)


def test_a_run_that_is_resumed_twice_has_its_checksums(stopped, tmp_path):
    """What is known of earlier files and rows goes on from session to session."""
    with pytest.raises(Enough):
        dealib.simulate(VISCOUS, stopped, resume=True, observers=[Stop(9)])
    resumed = resume(stopped)
    whole = dealib.simulate(VISCOUS, tmp_path / "whole")
    assert resumed.status == "done"
    for name in whole.history.columns.drop("stage"):
        assert resumed.history[name].to_numpy() == pytest.approx(
            whole.history[name].to_numpy(), rel=1e-9, abs=1e-12
        )
    saved = CheckpointFolder(stopped).read()
    for history in (resumed.history, resumed.states_file.history):
        assert len(history) == len(whole.history)
        assert history_sum(history.to_dict("records")) == saved.history


def test_a_checksum_of_rows_knows_values_and_order():
    one, two = {"step": 0, "force_N": 0.1, "stage": "a"}, {"step": 1, "force_N": 0.2, "stage": "1"}

    def total(*rows):
        return history_sum(rows)

    assert total(one, two) != total(two, one)
    assert total(one, two) != total(one)
    assert total(one, two) != total(one, two | {"force_N": np.nextafter(0.2, 1)})
    text = {"step": "1", "force_N": "0.2", "stage": "1", "more": ""}  # as a CSV file has it
    assert total(one, two) == total(one, text)

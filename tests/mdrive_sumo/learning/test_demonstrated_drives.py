"""Training data from takes: samples where a person drives on for as long as a plan lasts."""

from pathlib import Path

import numpy as np
import pytest
from testing.short_suite import make_short_suite
from testing.takes import (
    PERSON,
    SHARING,
    Branch,
    ProgrammedActions,
    invoke,
    let_drive,
    list_egos,
    load_recorded,
    make_take,
    record_take,
)

from mdrive_sumo.agents.learned.ego_frame import convert_to_world
from mdrive_sumo.agents.learned.system_spec import DECISION_TICKS
from mdrive_sumo.contract import Control, OwnState
from mdrive_sumo.learning.sample_format import split_key
from mdrive_sumo.learning.sample_reader import TrainingSample, read_samples
from mdrive_sumo.learning.shard_reading import load_dataset_file
from mdrive_sumo.runs.takes import Action, RecordedActions

pytestmark = pytest.mark.usefixtures("in_process")
HANDED_OVER = range(20, 40)
HORIZON = 60
"""Ticks of a plan."""


def drive_slowly(tick: int) -> Control:
    return Control(0.12 if tick < 60 else 0.05, 0.0, 0.0)


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take, and a branch of it at 5 s."""
    folder = tmp_path_factory.mktemp("takes")
    suite = make_short_suite(folder / "suite", "i01_*", metres=20)
    run = make_take(folder / "takes" / "1", suite)
    actions = {0: Action(PERSON), HANDED_OVER.start: Action(SHARING), HANDED_OVER.stop: Action(PERSON)}
    first = record_take(run, let_drive(list_egos(run), ProgrammedActions(actions, drive_slowly)))
    branch = {
        ego: Branch(
            RecordedActions(first, ego), 100, ProgrammedActions({100: Action(driver)}, lambda _: Control(0.2, 0, 0))
        )
        for ego, driver in zip(first.ego_ids, (PERSON, SHARING), strict=True)
    }
    record_take(make_take(folder / "takes" / "2", suite), branch)
    return folder


@pytest.fixture(scope="module")
def samples(takes: Path) -> list[TrainingSample]:
    ended = invoke("learn", "demonstrations", takes, "--out", takes / "data")
    assert ended.exit_code == 0, ended.output
    dataset = load_dataset_file(takes / "data")
    assert (dataset.expert, dataset.split, len(dataset.shards)) == ("human", "takes", 2)
    return list(read_samples(takes / "data"))


def test_samples_are_where_a_person_drives_on(takes: Path, samples: list[TrainingSample]) -> None:
    record = load_recorded(takes / "takes" / "1")
    ticks = [one.about.tick for one in samples if one.key.startswith("takes-000000")]
    last = record.find_ending("0").tick
    assert ticks == [tick for tick in range(HANDED_OVER.stop, last - HORIZON) if tick % DECISION_TICKS == 0]
    assert {(one.about.cav, one.about.expert) for one in samples} == {("0", "human")}
    branched = [one.about.tick for one in samples if one.key.startswith("takes-000001")]
    assert branched and min(branched) == 100  # what was before is the parent's


def test_plan_and_control_are_what_the_person_did(takes: Path, samples: list[TrainingSample]) -> None:
    record = load_recorded(takes / "takes" / "1")
    for one in samples[:8]:
        tick, labels = one.about.tick, one.labels
        pose = [float(values[tick, 0]) for values in (record.x, record.y, record.yaw, record.speed)]
        way = convert_to_world(
            labels["expert_plan"].astype(float), OwnState(pose[0], pose[1], pose[2], pose[3], 0.0, 0.0, 0.0)
        )
        later = tick + 10 * np.arange(1, 7)
        driven = np.stack((record.x[later, 0], record.y[later, 0]), axis=-1)
        assert np.abs(way - driven).max() < 1e-3
        assert labels["expert_control"].tolist() == pytest.approx(record.control_values[tick, 0].tolist())
        assert labels["perturbed"] == 0
        assert np.hypot(labels["own"][0] - pose[0], labels["own"][1] - pose[1]) < 1.0
    assert split_key(samples[0].key) == ("takes-000000_c0", HANDED_OVER.stop)


@pytest.mark.slow
def test_the_same_takes_give_the_same_bytes(takes: Path, samples: list[TrainingSample]) -> None:
    assert samples
    assert invoke("learn", "demonstrations", takes / "takes", "--out", takes / "again").exit_code == 0
    shards = sorted(path.name for path in (takes / "data").glob("*.tar"))
    for name in shards:
        assert (takes / "data" / name).read_bytes() == (takes / "again" / name).read_bytes()


def test_a_take_without_three_seconds_of_a_person(takes: Path, tmp_path: Path) -> None:
    run = make_take(tmp_path / "take", takes / "suite")
    actions = {0: Action(PERSON), 30: Action(SHARING)}
    record_take(run, let_drive(list_egos(run), ProgrammedActions(actions)))
    ended = invoke("learn", "demonstrations", run.folder, "--out", tmp_path / "out")
    assert (ended.exit_code, ended.stderr.count("Error")) == (2, 1), ended.output
    assert "expected a person who drives for 3 s or more, found none" in ended.stderr
    assert not (tmp_path / "out").exists()
    ended = invoke("learn", "demonstrations", run.folder, "--rig", "eyes", "--out", tmp_path / "out")
    assert (ended.exit_code, "--rig" in ended.stderr) == (2, True)

"""Making a data set: the same whatever the workers, resumable after a kill, damaged shards are made again."""

import json
import os
import signal
import subprocess
import sys
import tarfile
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from testing.processes import wait_for
from testing.training_data import SilentProgress, collect_here, copy_dataset, make_settings

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.learning import (
    collection,
    collection_settings,
    drive_episode,
    recording_agent,
    scenario_jobs,
    training_scenarios,
)
from mdrive_sumo.learning.collection import WAITING_FOLDER, collect_dataset
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.drive_episode import drive_scenario
from mdrive_sumo.learning.sample_format import DATASET_FILE, LABELS_SUFFIX, DatasetFile, split_key
from mdrive_sumo.learning.sample_reader import read_samples
from mdrive_sumo.learning.shard_reading import load_dataset_file

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
SHARD = "shard-000000.tar"
Content = dict[str, bytes]


@pytest.fixture
def one_a_shard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put every scenario into a shard of its own."""
    monkeypatch.setattr(collection, "SHARD_SCENARIOS", 1)


def read_content(folder: Path) -> Content:
    """Return all files of all samples."""
    content: Content = {}
    for path in sorted(folder.glob("shard-*.tar")):
        with tarfile.open(path) as shard:
            for member in shard:
                file = shard.extractfile(member)
                assert file is not None and member.name not in content
                content[member.name] = file.read()
    return content


def test_shards_are_tar_files_in_the_layout_of_webdataset(dataset: Path) -> None:
    with tarfile.open(dataset / SHARD) as shard:
        members = shard.getmembers()
    keys = [member.name.split(".", 1)[0] for member in members]
    assert {member.mtime for member in members} == {0}
    assert {member.name.split(".", 1)[1] for member in members} == {LABELS_SUFFIX, "instruction.txt", "about.json"}
    assert keys == [key for key in dict.fromkeys(keys) for _ in range(3)]  # the files of a sample stand together
    drives = [key.rsplit("_", 1)[0] for key in keys]
    assert drives == sorted(drives)
    assert all(part.replace("-", "").isalnum() for key in keys for part in key.split("_"))


def test_dataset_file_counts_what_there_is(dataset: Path) -> None:
    about = load_dataset_file(dataset)
    keys = {name.split(".", 1)[0] for name in read_content(dataset)}
    assert about.samples == len(keys) == sum(one.samples for shard in about.shards for one in shard.scenarios) > 200
    assert (about.split, about.expert, about.rigs, about.requested) == ("train", "omniscient", (), 2)
    sample = next(iter(read_samples(dataset)))
    assert (sample.about.cav, sample.about.expert, sample.about.round) == ("0", "omniscient", 0)


@pytest.mark.usefixtures("one_a_shard")
def test_samples_do_not_depend_on_workers_and_shards(short_suite: Path, dataset: Path, tmp_path: Path) -> None:
    found = collect_dataset(make_settings(short_suite), tmp_path / "set", 2, 2, SilentProgress(), False)
    assert len(found.shards) == 2
    assert read_content(tmp_path / "set") == read_content(dataset)


def test_a_killed_collection_is_continued_with_the_same_bytes(short_suite: Path, dataset: Path, tmp_path: Path) -> None:
    """SIGKILL while the second of two scenarios of a shard is driven: the first is kept."""
    folder, settings = tmp_path / "killed", make_settings(short_suite)
    command = [sys.executable, "-m", "mdrive_sumo", "learn", "data", "--split", "train", "--scenarios", "2"]
    options = ["--seed", str(settings.seed), "--perturb", "2", "--suite", str(short_suite)]
    more = ["--workers", "1", "--out", str(folder)]
    journal = folder / "journal.jsonl"
    with subprocess.Popen([*command, *options, *more], stderr=subprocess.DEVNULL) as process:
        try:
            wait_for(lambda: journal.exists() and b'"waiting"' in journal.read_bytes(), 120)
        finally:
            os.kill(process.pid, signal.SIGKILL)
    assert not (folder / SHARD).exists() and load_dataset_file(folder).samples == 0
    for place in (folder, folder / WAITING_FOLDER):
        (place / ".0123456789abcdef.part").write_bytes(b"half a file")
    found, progress = collect_here(settings, folder, 2)
    assert (progress.waiting, progress.driven, progress.made) == (1, [1], [SHARD])
    assert found == load_dataset_file(dataset)
    assert (folder / SHARD).read_bytes() == (dataset / SHARD).read_bytes()
    assert not list(folder.glob(".*")) and not (folder / WAITING_FOLDER).exists()


def test_a_collection_that_ends_before_its_shard_is_packed_drives_nothing_again(
    short_suite: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    settings, folder = make_settings(short_suite), tmp_path / "set"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(collection, "write_shard", interrupt)
        patch.setattr(collection, "order_jobs", lambda jobs, _: jobs[::-1])
        collect_here(settings, folder)
    _, progress = collect_here(settings, folder)
    assert (progress.waiting, progress.driven, progress.made) == (2, [], [SHARD])
    assert (folder / SHARD).read_bytes() == (dataset / SHARD).read_bytes()  # whatever was driven first


@pytest.mark.parametrize("damage", ["cut", "changed", "gone"])
def test_a_damaged_shard_is_made_again(damage: str, short_suite: Path, dataset: Path, tmp_path: Path) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    shard = folder / SHARD
    data = shard.read_bytes()
    if damage == "gone":
        shard.unlink()
    else:
        shard.write_bytes(data[: len(data) // 2] if damage == "cut" else data[:600] + b"\x7f" + data[601:])
    _, progress = collect_here(make_settings(short_suite), folder)
    assert progress.made == [SHARD] and "made again" in progress.notes[0]
    assert shard.read_bytes() == data


def test_a_finished_collection_drives_nothing_again_and_a_larger_one_extends_it(
    short_suite: Path, dataset: Path, tmp_path: Path
) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    found, progress = collect_here(make_settings(short_suite), folder)
    assert (progress.kept, progress.made) == (1, [])
    assert found == load_dataset_file(dataset)
    found, progress = collect_here(make_settings(short_suite), folder, 5)
    assert progress.made == [SHARD, "shard-000001.tar"]  # its first shard had two of four scenarios
    assert read_content(folder).items() >= read_content(dataset).items()
    assert [one.index for shard in found.shards for one in shard.scenarios] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("changes", "part"),
    [({"seed": 4}, "seed 3 (now 4)"), ({"expert": "single"}, "expert omniscient"), ({"rigs": ("tcp",)}, "rigs")],
    ids=["seed", "expert", "rigs"],
)
def test_a_folder_with_another_data_set_is_refused(
    changes: dict[str, object], part: str, short_suite: Path, dataset: Path, tmp_path: Path
) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    with pytest.raises(InputError, match="found one with another") as caught:
        collect_here(make_settings(short_suite, **changes), folder)
    assert part in str(caught.value)


def test_samples_of_two_versions_never_mix(
    short_suite: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    monkeypatch.setattr(training_scenarios, "VERSION", 99)
    monkeypatch.setattr(collection_settings, "compute_code_checksum", lambda: "sha256:of a later version")
    with pytest.raises(InputError, match="found one with another") as caught:
        collect_here(make_settings(short_suite), folder, 5)
    assert "generator 2 (now 99)" in str(caught.value) and "code" in str(caught.value)


def test_fresh_starts_anew(short_suite: Path, dataset: Path, tmp_path: Path) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    (folder / "shard-000007.tar").write_bytes(b"of the earlier data set")
    _, progress = collect_here(make_settings(short_suite, seed=4), folder, 1, fresh=True)
    assert progress.made == [SHARD] and [path.name for path in folder.glob("*.tar")] == [SHARD]
    assert load_dataset_file(folder).seed == 4


def fail_first(settings: CollectionSettings, index: int) -> object:
    if index == 0:
        raise RuntimeError("the worker said no")
    return drive_episode.collect_scenario(settings, index)


def fail_to_drive(settings: CollectionSettings, scenario: Any, *rest: Any) -> object:
    if "i12" in str(scenario):
        raise WorldError("SUMO said no")
    return drive_scenario(settings, scenario, *rest)


@pytest.mark.parametrize(
    ("module", "name", "fail", "reason"),
    [
        (drive_episode, "drive_scenario", fail_to_drive, "SUMO said no"),
        (scenario_jobs, "collect_scenario", fail_first, "the worker said no"),
    ],
    ids=["simulator", "worker"],
)
def test_a_scenario_that_fails_costs_only_itself_and_is_tried_again(
    module: ModuleType, name: str, fail: object, reason: str, short_suite: Path, dataset: Path, tmp_path: Path
) -> None:
    settings, folder = make_settings(short_suite), tmp_path / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, name, fail)
        found, _ = collect_here(settings, folder)
    first, second = found.shards[0].scenarios
    assert (first.status, second.status) == ("failed", "done") and reason in first.reason
    assert 0 < found.samples < load_dataset_file(dataset).samples
    _, progress = collect_here(settings, folder)
    assert (progress.driven, progress.made) == ([0], [SHARD])
    assert (folder / SHARD).read_bytes() == (dataset / SHARD).read_bytes()


def test_damaged_samples_of_a_waiting_scenario_are_made_again(
    short_suite: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, folder = make_settings(short_suite), tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setattr(scenario_jobs, "collect_scenario", fail_first)
        collect_here(settings, folder)
    (waiting,) = (path for path in (folder / WAITING_FOLDER).iterdir() if path.stat().st_size)
    waiting.write_bytes(waiting.read_bytes()[:-1])
    _, progress = collect_here(settings, folder)
    assert progress.driven == [0, 1] and "made again" in progress.notes[0]
    assert (folder / SHARD).read_bytes() == (dataset / SHARD).read_bytes()


def test_dataset_file_is_valid_by_its_published_schema(dataset: Path) -> None:
    DatasetFile.model_validate(json.loads((dataset / DATASET_FILE).read_text()))


def test_a_share_of_the_decisions_is_kept_in_turns(
    short_suite: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_agent, "TURN_TICKS", 8)  # drives of the short suite are shorter than a turn of 3 s
    made, _ = collect_here(make_settings(short_suite, share=0.25), tmp_path / "part")
    assert made.share == 0.25
    part, whole = read_content(tmp_path / "part"), read_content(dataset)
    assert 0.1 * len(whole) < len(part) < 0.4 * len(whole)
    assert part.items() <= whole.items()  # what is kept does not change
    ticks: dict[str, list[int]] = {}
    for key in sorted({name.split(".", 1)[0] for name in part}):
        drive, tick = split_key(key)
        ticks.setdefault(drive, []).append(tick)
    steps = {later - tick for each in ticks.values() for tick, later in pairwise(each)}
    assert steps == {4, 28}

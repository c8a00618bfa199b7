"""Making a data set: the same whatever the workers, resumable after a kill, damaged shards are made again."""

import json
import os
import signal
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from testing.processes import wait_for
from testing.training_data import SilentProgress, collect_here, copy_dataset, make_settings

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.learning import collection, collection_settings, drive_episode, training_scenarios
from mdrive_sumo.learning.collection import collect_dataset
from mdrive_sumo.learning.sample_format import DATASET_FILE, LABELS_SUFFIX, DatasetFile
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


@pytest.mark.usefixtures("one_a_shard")
def test_a_killed_collection_is_continued_with_the_same_samples(
    short_suite: Path, dataset: Path, tmp_path: Path
) -> None:
    """SIGKILL while the second of two shards is made."""
    folder, settings = tmp_path / "killed", make_settings(short_suite)
    program = (
        "from mdrive_sumo.cli import main; from mdrive_sumo.learning import collection;"
        " collection.SHARD_SCENARIOS = 1; main()"
    )
    command = [sys.executable, "-c", program, "learn", "data", "--split", "train"]
    options = ["--scenarios", "2", "--seed", str(settings.seed), "--perturb", "2", "--suite", str(short_suite)]
    more = ["--workers", "1", "--out", str(folder)]
    with subprocess.Popen([*command, *options, *more], stderr=subprocess.DEVNULL) as process:
        try:
            wait_for(lambda: (folder / SHARD).exists(), 120)
        finally:
            os.kill(process.pid, signal.SIGKILL)
    left = sorted(path.name for path in folder.glob("shard-*.tar"))
    (folder / ".0123456789abcdef.part").write_bytes(b"half a shard")
    found, progress = collect_here(settings, folder, 2)
    assert left == [SHARD] and progress.kept <= 1
    assert len(found.shards) == 2
    assert read_content(folder) == read_content(dataset)
    assert not list(folder.glob(".*"))


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
    assert "generator 1 (now 99)" in str(caught.value) and "code" in str(caught.value)


def test_fresh_starts_anew(short_suite: Path, dataset: Path, tmp_path: Path) -> None:
    folder = copy_dataset(dataset, tmp_path / "set")
    (folder / "shard-000007.tar").write_bytes(b"of the earlier data set")
    _, progress = collect_here(make_settings(short_suite, seed=4), folder, 1, fresh=True)
    assert progress.made == [SHARD] and [path.name for path in folder.glob("*.tar")] == [SHARD]
    assert load_dataset_file(folder).seed == 4


def test_a_scenario_that_fails_costs_only_itself_and_is_tried_again(
    short_suite: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = drive_episode.drive_scenario

    def fail_once(settings: object, scenario: object, *rest: object) -> object:
        if "i12" in str(scenario):
            raise WorldError("SUMO said no")
        return real(settings, scenario, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(drive_episode, "drive_scenario", fail_once)
        found, _ = collect_here(make_settings(short_suite), tmp_path / "set")
    first, second = found.shards[0].scenarios
    assert (first.status, first.reason, second.status) == ("failed", "SUMO said no", "done")
    assert 0 < found.samples < load_dataset_file(dataset).samples
    found, progress = collect_here(make_settings(short_suite), tmp_path / "set")
    assert progress.made == [SHARD]
    assert read_content(tmp_path / "set") == read_content(dataset)


def test_dataset_file_is_valid_by_its_published_schema(dataset: Path) -> None:
    DatasetFile.model_validate(json.loads((dataset / DATASET_FILE).read_text()))

"""`mdrive-sumo learn scans` on the command line: the same bytes whatever the workers, it goes on, and mistakes."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from testing.local_executor import LocalExecutor
from testing.processes import wait_for

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.learning.fusion import drive_frames, frame_collection
from mdrive_sumo.learning.fusion.frame_files import INDEX_NAME, read_frames
from mdrive_sumo.learning.fusion.frames import check_places_differ

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


def learn_scans(suite: Path, out: Path, *words: str | int | Path) -> Result:
    defaults = {"--split": "train", "--scenarios": "2", "--interval-s": "1"}
    given = [word for name, value in defaults.items() if name not in words for word in (name, value)]
    given += [] if "--suite" in words else ["--suite", str(suite)]
    options = [*given, "--out", out, *words]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
        return CliRunner().invoke(main, ["learn", "scans", *map(str, options)])


@pytest.fixture(scope="module")
def frame_set(short_suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the frames of two scenarios; never changed."""
    folder = tmp_path_factory.mktemp("scans") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive_frames, "POINTS_SHARE", 0.3)
        ended = learn_scans(short_suite, folder)
    assert ended.exit_code == 0, ended.output
    return folder


def read_content(folder: Path) -> dict[str, bytes]:
    """Return what collections of the same scenarios have in common."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name.startswith("frames")}


def test_the_set_is_read_and_says_what_it_is(frame_set: Path) -> None:
    frames = read_frames(frame_set)
    index = json.loads((frame_set / INDEX_NAME).read_text())
    assert (index["split"], index["expert"], index["interval_ticks"]) == ("train", "sharing+negotiation", 20)
    assert index["frames"] == len(frames) > 20 and len(index["shards"]) == 2 == len(set(frames.episode.tolist()))
    senders = np.bincount((frames.scan[:, 1:, 0] >= 0).sum(axis=1), minlength=5)[1:]
    assert senders.tolist() == np.sum([one["senders"] for one in index["scenarios"]], axis=0).tolist()
    assert (frames.scan[frames.scan[..., 0] < 0] == -1).all() and (frames.scan[:, 0, 1:] == -1).all()
    assert (frames.scan[:, 1] >= 0).mean() > 0.9 and len(DELAYS_TICKS) == frames.scan.shape[2]
    assert frames.is_target.sum(axis=1).min() > 0  # at least the sender


def test_points_beside_fill_the_cells_of_their_scans(frame_set: Path) -> None:
    """To the centimetre: points at edges of cells may change sides."""
    from mdrive_sumo.agents.learned.point_grid import build_point_cells, expand_cells

    paths = sorted(frame_set.glob("points-*.npz"))
    assert paths
    with np.load(paths[0]) as kept:
        frames = read_frames_of(frame_set, paths[0].name.replace("points", "frames"))
        for number, start, end in zip(kept["scan"], kept["starts"][:-1], kept["starts"][1:], strict=True):
            cloud = (kept["points"][start:end] / 100.0).astype(np.float32)
            cells, expected = (
                expand_cells(one).astype(int) for one in (build_point_cells(cloud), frames.get_scan(number))
            )
            assert np.abs(cells - expected).sum() < 0.06 * expected.sum()
        assert len(kept["intensity"]) == len(kept["points"]) and kept["intensity"].any()


def read_frames_of(folder: Path, name: str) -> frame_collection.FusionFrames:
    """Return the frames of one archive."""
    from mdrive_sumo.learning.fusion.frame_files import _read_shard

    return _read_shard(folder / name)


@pytest.mark.full  # in `make test`: test_collection kills the collector, which both share, and gives it two workers
def test_bytes_do_not_depend_on_workers_nor_on_kills(short_suite: Path, frame_set: Path, tmp_path: Path) -> None:
    """SIGKILL after the first scenario; two workers go on."""
    folder = tmp_path / "killed"
    command = [sys.executable, "-m", "mdrive_sumo", "learn", "scans", "--split", "train", "--scenarios", "2"]
    options = ["--interval-s", "1", "--suite", str(short_suite), "--out", str(folder), "--workers"]
    journal = folder / "journal.jsonl"
    with subprocess.Popen([*command, *options, "1"], stderr=subprocess.DEVNULL) as process:
        try:
            wait_for(lambda: journal.exists() and b'"waiting"' in journal.read_bytes(), 120)
        finally:
            os.kill(process.pid, signal.SIGKILL)
    ended = subprocess.run([*command, *options, "2"], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "of 2 scenarios are there" in ended.stderr
    assert read_content(folder) == read_content(frame_set)


def test_what_is_there_is_kept_and_what_is_damaged_made_again(short_suite: Path, tmp_path: Path) -> None:
    assert learn_scans(short_suite, tmp_path / "set", "--scenarios", 1).exit_code == 0
    content = read_content(tmp_path / "set")
    path = tmp_path / "set/frames-000000.npz"
    again = learn_scans(short_suite, tmp_path / "set", "--scenarios", 1)
    assert again.exit_code == 0 and "continuing: 1 of 1 scenarios" in again.output
    path.write_bytes(path.read_bytes()[:-9])
    again = learn_scans(short_suite, tmp_path / "set", "--scenarios", 1)
    assert again.exit_code == 0 and "made again" in again.output
    assert read_content(tmp_path / "set") == content
    fresh = learn_scans(short_suite, tmp_path / "set", "--scenarios", 1, "--interval-s", 2, "--fresh")
    assert fresh.exit_code == 0 and read_content(tmp_path / "set") != content


@pytest.mark.parametrize("words", [("--least-cavs", 6), ("--least-others", 9)])
def test_scenarios_with_too_few_are_not_driven(
    words: tuple[str, int], short_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_collection, "drive_scenario", None)
    ended = learn_scans(short_suite, tmp_path / "set", *words)
    assert ended.exit_code == 0 and "0           2       0" in ended.output
    with pytest.raises(
        InputError, match=r"frames\.json: shards: expected the names of one archive or more, found \[\]"
    ):
        read_frames(tmp_path / "set")


def test_a_scenario_that_fails_costs_only_itself(
    short_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise WorldError("SUMO said no")

    monkeypatch.setattr(frame_collection, "drive_scenario", fail)
    ended = learn_scans(short_suite, tmp_path / "set", "--scenarios", 1)
    assert ended.exit_code == 1 and "scenario 0 (i12_ins_sl_old_town) failed: SUMO said no" in ended.output
    monkeypatch.undo()
    again = learn_scans(short_suite, tmp_path / "set", "--scenarios", 1)
    assert again.exit_code == 0 and len(read_frames(tmp_path / "set")) > 0


def test_places_of_two_splits_that_are_the_same_cannot_judge(frame_set: Path) -> None:
    frames = read_frames(frame_set)
    with pytest.raises(InputError, match="places of the validation set: expected none of the training set, found"):
        check_places_differ(frames, frames, "validation")


def test_ctrl_c_says_how_to_continue_and_leaves_an_index(
    short_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("signal.signal", lambda *_: None)  # the command ignores a second Ctrl-C
    monkeypatch.setattr("mdrive_sumo.learning.collection.run_jobs", interrupt)
    ended = learn_scans(short_suite, tmp_path / "set")
    assert ended.exit_code == 130 and "interrupted; the same command continues" in ended.output
    assert json.loads((tmp_path / "set" / INDEX_NAME).read_text())["frames"] == 0


def test_the_folder_of_another_data_set_is_refused(short_suite: Path, frame_set: Path, dataset: Path) -> None:
    before = read_content(frame_set)
    for folder, words in ((dataset, ()), (frame_set, ("--seed", 5)), (frame_set, ("--interval-s", 4))):
        ended = learn_scans(short_suite, folder, *words)
        assert ended.exit_code == 2 and "found one with another" in ended.output, ended.output
    assert read_content(frame_set) == before
    with pytest.raises(InputError, match=r"expected the index of fusion frames, found No such file .*learn scans"):
        read_frames(dataset)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--split", "trial"), "'--split': expected one of train, val, test, found 'trial'"),
        (("--expert", "idm"), "expected one of omniscient, sharing+negotiation, single, found 'idm'"),
        (("--scenarios", "0"), "'--scenarios'"),
        (("--interval-s", "0.1"), "'--interval-s'"),
        (("--interval-s", "nan"), "expected a number, found 'nan'"),
        (("--least-cavs", "1"), "'--least-cavs'"),
        (("--suite", "nothing"), "suite 'nothing': expected a folder or one of"),
    ],
)
def test_a_mistake_is_one_sentence(
    words: tuple[str, ...], part: str, short_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = learn_scans(short_suite, tmp_path / "set", *words)
    assert ended.exit_code == 2 and "Traceback" not in ended.output
    assert part in " ".join(ended.output.split())

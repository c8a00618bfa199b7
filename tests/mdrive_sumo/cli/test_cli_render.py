"""`mdrive-sumo render`, from the command line to the file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image
from testing.local_executor import run_in_process
from testing.mixed_run import SCENARIO, drive_mixed_run

import mdrive_sumo as md
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.render import picture_files

pytestmark = pytest.mark.slow

SMALL = ("--size", "320x180")


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        return drive_mixed_run(tmp_path_factory.mktemp("render"))


def call(*words: object) -> Result:
    return CliRunner().invoke(main, ["render", *(str(word) for word in words)])


def read_picture(path: Path) -> Any:
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


def test_a_picture_has_its_size_and_the_same_bytes_each_time(run_folder: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "new" / "a.png", tmp_path / "b.png"
    for path in (first, second):
        done = call(run_folder, "--scenario", "mix*", "--out", path, "--size", "400x300")
        assert (done.exit_code, done.output) == (0, f"{path}\n"), done.output
    assert read_picture(first).shape == (300, 400, 3)
    assert first.read_bytes() == second.read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"new", "b.png"}


def test_views_and_ticks_differ(run_folder: Path, tmp_path: Path) -> None:
    options = ((), ("--tick", 1), ("--follow", "1"), ("--view", "chase"), ("--view", "chase", "--follow", "1"))
    pictures = set[bytes]()
    for i, more in enumerate(options):
        assert call(run_folder, "--out", tmp_path / f"{i}.png", *SMALL, *more).exit_code == 0
        pictures.add(read_picture(tmp_path / f"{i}.png").tobytes())
    assert len(pictures) == len(options)


def read_gif(path: Path) -> tuple[list[Any], list[int]]:
    """Frames as arrays, and their durations [ms]."""
    frames: list[Any] = []
    durations: list[int] = []
    with Image.open(path) as gif:
        for i in range(getattr(gif, "n_frames", 1)):
            gif.seek(i)
            durations.append(int(gif.info["duration"]))
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
        assert gif.info["loop"] == 0
    return frames, durations


@pytest.mark.parametrize("more", [(), ("--view", "chase", "--speed", "2", "--fps", "5")])
def test_a_gif_shows_the_ticks_in_their_time(run_folder: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    """Each frame against the picture of its tick, up to the palette; equal frames become one that lasts longer."""
    path = tmp_path / "x.gif"
    done = call(run_folder, "--out", path, *SMALL, "--from", 4, "--to", 20, *more)
    assert done.exit_code == 0, done.output
    frames, durations = read_gif(path)
    ticks = list(range(4, 21, 8 if more else 2))
    assert sum(durations) == len(ticks) * (200 if more else 100) + 1000
    assert len(frames) == len(ticks)
    for frame, tick in ((frames[0], ticks[0]), (frames[-1], ticks[-1])):
        png = tmp_path / f"{tick}.png"
        assert call(run_folder, "--out", png, *SMALL, "--tick", tick, *more[:2]).exit_code == 0
        difference = np.abs(frame - read_picture(png)).max(-1)
        assert np.mean(difference > 24) < 0.01


def test_runs_stand_side_by_side(run_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "two.png"
    assert call(run_folder, run_folder, "--out", path, "--size", "645x200").exit_code == 0
    picture = read_picture(path)
    assert picture.shape == (200, 645, 3)
    assert np.array_equal(picture[:, :320], picture[:, 324:644])
    assert (picture[:, 320:324] == 255).all()


FAKE_FFMPEG = """#!/bin/sh
for last; do :; done
cat > "$last"
echo "$@" > "$last.words"
"""


def test_an_mp4_is_what_ffmpeg_makes_of_the_frames(
    run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program in place of ffmpeg keeps the frames that it gets."""
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text(FAKE_FFMPEG.replace('"$last.words"', str(tmp_path / "words")))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    path = tmp_path / "x.mp4"
    done = call(run_folder, "--out", path, *SMALL, "--to", 9)
    assert done.exit_code == 0, done.output
    assert path.stat().st_size == 10 * 320 * 180 * 3  # 20 frames a second: every tick
    words = (tmp_path / "words").read_text()
    assert "-s 320x180 -r 20" in words and "yuv420p" in words


def test_a_failing_ffmpeg_is_one_sentence_and_leaves_nothing(
    run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 8\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    done = call(run_folder, "--out", tmp_path / "x.mp4", *SMALL)
    assert done.exit_code == 2
    assert done.stderr.endswith("ffmpeg failed with exit code 8: Unknown encoder libx264\n")
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--out", "x.jpg"), "x.jpg: expected a name that ends in .png, .gif, .mp4, found .jpg"),
        (("--out", "x"), "expected a name that ends in .png, .gif, .mp4, found no ending"),
        (("--out", "there.png"), "there.png: expected a new file, found one there; --force replaces it"),
        (("--out", "folder.png"), "folder.png: expected a new file, found a folder there"),
        (("--out", "there.png/x.png"), "there.png/x.png: cannot be written: "),
        (("--out", "x.mp4"), "expected the program ffmpeg for .mp4, found none; install it"),
        (("--out", "x.png", "--scenario", "mixd"), "found 'mixd'; did you mean 'mixed'?"),
        (("--out", "x.png", "--follow", "7"), "render: follow: expected one of 0, 1, found '7'"),
        (("--out", "x.png", "--tick", "9999"), "render: tick: expected a tick of 0 to "),
        (("--out", "x.png", "--tick", "-1"), "found -1"),
        (("--out", "x.png", "--fps", "5"), "render: fps: expected only with a video (.gif, .mp4), found 5"),
        (("--out", "x.gif", "--tick", "5"), "render: tick: expected only with a picture (.png), found 5"),
        (("--out", "x.gif", "--from", "9", "--to", "5"), "render: to: expected a tick of 9 to "),
        (("--out", "x.gif", "--fps", "51"), "render: fps: expected 1 to 50, found 51"),
        (("--out", "x.gif", "--speed", "0"), "render: speed: expected 0.05 to 20, found 0"),
        (("--out", "x.gif", "--speed", "nan"), "render: speed: expected 0.05 to 20, found nan"),
        (("--out", "x.gif", "--size", "4096x4096", "--fps", "50"), "pixels in all frames of a .gif"),
        (("--out", "x.png", "--size", "9x900"), "render: size: width: expected 160 to 4096 pixels, found 9"),
        (("--out", "x.png", "--size", "big"), "expected WIDTHxHEIGHT in pixels, such as 1280x720, found 'big'"),
        (("--out", "x.png", "--seed", "4"), "--seed: expected one of the run's, 0, found 4"),
        (("--out", "x.png", "--view", "chas"), "did you mean 'chase'?"),
    ],
)
def test_bad_input_is_one_sentence_and_no_file(
    run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(picture_files, "FFMPEG", "a-program-that-nobody-has")
    Path("there.png").write_text("mine")
    Path("folder.png").mkdir()
    done = call(run_folder, *words)
    assert (done.exit_code, sentence in done.stderr) == (2, True), done.output
    assert done.stderr.count("Error:") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"there.png", "folder.png"}
    assert Path("there.png").read_text() == "mine"


def test_a_run_without_recordings_is_one_sentence(tmp_path: Path, in_process: None) -> None:
    run = drive_mixed_run(tmp_path, "--no-record")
    done = call(run, "--out", tmp_path / "x.png")
    assert (done.exit_code, "found one made with --no-record" in done.stderr) == (2, True)


def test_a_notebook_renders_an_episode(run_folder: Path, tmp_path: Path) -> None:
    episode = md.load_run(run_folder).episode(SCENARIO)
    for _ in range(2):  # the file of a cell that runs again is replaced
        assert episode.render(tmp_path / "x.png", view="chase", follow="1", size=(320, 180)) == tmp_path / "x.png"
    assert read_picture(tmp_path / "x.png").shape == (180, 320, 3)
    with pytest.raises(InputError, match="follow: expected one of 0, 1"):
        episode.render(tmp_path / "x.png", follow="x")

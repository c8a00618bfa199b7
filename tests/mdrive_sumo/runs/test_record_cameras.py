"""`eval --record-cameras`, the replay with its images, and `render --view driver`."""

import io
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image
from testing.camera_scenes import needs_opengl
from testing.local_executor import run_in_process
from testing.mixed_run import SCENARIO, drive_mixed_run
from testing.study_talker import Talker

import mdrive_sumo as md
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.episode.camera_archive import encode_image, load_camera_tracks
from mdrive_sumo.report.render import perspective_painters
from mdrive_sumo.report.render.perspective_painters import DRIVER, DRIVER_FOV_DEG, DriverViewPainter

pytestmark = [needs_opengl, pytest.mark.slow]
WIDTH, HEIGHT = 320, 180


class CameraTalker(Talker):
    """Sees what the driver's view shows."""

    def sensors(self) -> tuple[SensorSpec, ...]:
        image = {"width": WIDTH, "height": HEIGHT, "fov_deg": DRIVER_FOV_DEG, "every_ticks": 4}
        pose = {"x": DRIVER.x, "y": DRIVER.y, "z": DRIVER.z}
        return (*super().sensors(), SensorSpec("camera", "eyes", options={**image, **pose}))


def test_the_python_front_door_keeps_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)
    md.evaluate("interdrive@0", "tcp", scenario="i01*", record_cameras=True, workers=1, out=tmp_path, progress=False)
    (archive,) = (tmp_path / "cameras").iterdir()
    assert len(load_camera_tracks(archive)) == 2


def drive(folder: Path, *options: str) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        names = {**AGENTS, "talker": CameraTalker}
        for module in ("mdrive_sumo.agents.registry", "mdrive_sumo.runs.open_agents", "mdrive_sumo.runs.agent_spec"):
            patch.setattr(f"{module}.AGENTS", names)
        return drive_mixed_run(folder, *options)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drive(tmp_path_factory.mktemp("with"), "--record-cameras")


def call(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def test_images_are_kept_at_the_rate_of_the_sensor_and_change_no_digest(run_folder: Path, tmp_path: Path) -> None:
    tracks = load_camera_tracks(run_folder / "cameras" / f"{SCENARIO}.zip")
    assert [(track.ego, track.camera) for track in tracks] == [("0", "eyes"), ("1", "eyes")]
    ticks = sorted(tracks[0].images)
    assert ticks[:3] == [0, 4, 8] and len(ticks) > 5
    without = drive(tmp_path)
    assert not (without / "cameras").exists()
    recordings = [load_episode(folder / "episodes" / f"{SCENARIO}.npz") for folder in (run_folder, without)]
    assert (recordings[0].digests == recordings[1].digests).all()


def test_the_replay_shows_them(run_folder: Path) -> None:
    done = call("view", run_folder, "--scenario", SCENARIO, "--no-open")
    assert done.exit_code == 0, done.output
    assert 'id="camera-images"' in (run_folder / "view" / f"{SCENARIO}.html").read_text("utf-8")
    (run_folder / "cameras" / f"{SCENARIO}.zip").rename(run_folder / "kept.zip")
    (run_folder / "cameras" / f"{SCENARIO}.zip").write_bytes(b"broken")
    done = call("view", run_folder, "--scenario", SCENARIO, "--no-open")
    assert done.exit_code == 2 and "expected camera images" in done.output
    (run_folder / "kept.zip").rename(run_folder / "cameras" / f"{SCENARIO}.zip")


def test_the_drivers_view_of_a_recording_is_what_the_agent_saw(
    run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to JPEG, and to the millimetre at which recordings keep places."""
    monkeypatch.setattr(
        DriverViewPainter, "paint", lambda self, tick: (self.paint_world(tick), self.canvas.to_array())[1]
    )
    track = load_camera_tracks(run_folder / "cameras" / f"{SCENARIO}.zip")[1]
    for tick in sorted(track.images)[::3]:
        path = tmp_path / f"{tick}.png"
        size = f"{WIDTH}x{HEIGHT}"
        done = call(
            "render", run_folder, "--view", "driver", "--follow", "1", "--tick", tick, "--size", size, "--out", path
        )
        assert done.exit_code == 0, done.output
        again = np.asarray(Image.open(io.BytesIO(encode_image(np.asarray(Image.open(path).convert("RGB"))))))
        seen = np.asarray(Image.open(io.BytesIO(track.images[tick])))
        assert np.abs(again.astype(int) - seen).mean() < 1.0


def test_without_a_renderer_the_drivers_view_is_one_sentence(
    run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise InputError('camera: expected the package moderngl, found none; pip install ".[camera]"')

    monkeypatch.setattr(perspective_painters, "load_renderer", fail)
    done = call("render", run_folder, "--view", "driver", "--out", tmp_path / "x.png")
    assert done.exit_code == 2
    assert 'pip install ".[camera]"' in done.output
    assert not (tmp_path / "x.png").exists()

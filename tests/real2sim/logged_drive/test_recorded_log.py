"""The log of a converted scenario as a recording: what happened, tick by tick, and nothing that is judged."""

from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, FRAMES, Made, crossing, made, seconds, track

from mdrive_sumo.episode import EpisodeRecord, load_episode, save_episode
from mdrive_sumo.roads import RoadMap
from real2sim.logged_drive import record_log
from real2sim.recording import RecordedTrack

LAST_TICK = round((FRAMES - 1) * DT_S * 20)


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def recorded(scene: Made, *changed: RecordedTrack) -> EpisodeRecord:
    tracks = {one.id: one for one in (*scene.tracks, *changed)}
    return record_log(scene.scenario, tracks, DT_S, {"agent": "log"})


def test_every_frame_of_the_log_is_in_it_to_the_last(roads: RoadMap) -> None:
    """A parked car in the way is no contact, and passing the goal is no end: nothing is judged."""
    scene = made(roads, track("parked", 340.0, 0.4, parked=True), track("ahead", 330.0 + 4.0 * seconds(), 3.5))
    found = recorded(scene)
    assert (found.ticks, found.contacts, found.egos) == (LAST_TICK + 1, (), 1)
    at = np.arange(FRAMES) * 2
    for one in scene.tracks:
        column = found.ids.index(one.id)
        assert found.x[at, column] == pytest.approx(one.x, abs=6e-4)
        assert found.y[at, column] == pytest.approx(one.y, abs=6e-4)
        assert (found.length[column], found.width[column]) == (4.5, 1.8)
    assert found.valid.all()
    assert found.speed[:, 0] == pytest.approx(8.0, abs=1e-3)
    assert found.x[1, 0] == pytest.approx(300.4, abs=6e-4)  # half-way between two frames of the log


def test_a_cav_whose_track_ends_leaves_and_the_others_stay(roads: RoadMap) -> None:
    second = 20.0 + 8.0 * seconds()
    scene = made(roads, track("second", second, 0.0), cavs=("cav", "second"))
    found = recorded(scene, track("second", np.where(seconds() <= 6.0, second, np.nan), 0.0))
    ends = {ending.ego: ending.tick for ending in found.endings}
    assert ends == {"cav": LAST_TICK, "second": 120}
    column = found.ids.index("second")
    assert found.valid[:121, column].all() and not found.valid[121:, column].any()


def test_the_same_log_gives_the_same_file(roads: RoadMap, tmp_path: Path) -> None:
    scene = made(roads)
    for name in ("a.npz", "b.npz"):
        save_episode(recorded(scene), tmp_path / name)
    assert load_episode(tmp_path / "a.npz").digest == load_episode(tmp_path / "b.npz").digest
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()

"""The V2XPnP writer: exact without noise, and with the noise that was measured on the real frames with it."""

import math
import re
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.shared_material import SHARED_DATA, needs_data
from testing.v2xpnp_writer_samples import FRAMES, HALF_MM, by_id, same_tracks, scene, track, tracks

from mdrive_sumo.core.geometry import wrap_angles
from real2sim.hd_map import HdMap
from real2sim.readers.scenarionet import read_scenarionet
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recording import ObjectCategory, ObserverView, Recording
from real2sim.writers.observation_noise import ObservationNoise, simulate_observers
from real2sim.writers.v2xpnp import LABEL_BY_CATEGORY, write_v2xpnp, write_views
from real2sim.writers.v2xpnp_map import write_vector_map

REAL = SHARED_DATA / "real_logs/scenarionet_nuscenes/sd_nuscenes_scene-0757.pkl"


EXCERPT = SHARED_DATA / "v2xpnp_excerpt" / "2023-03-17-16-12-12_3_0"


@st.composite
def views(draw: st.DrawFn, observer: str, frames: int) -> ObserverView:
    names = draw(st.lists(st.integers(0, 999).map(str), max_size=4, unique=True))
    pose = np.array(
        draw(st.lists(st.tuples(*[st.floats(-300, 300)] * 2, st.floats(-3.14, 3.14)), min_size=frames, max_size=frames))
    )
    return ObserverView(observer, tuple(draw(tracks(name, frames)) for name in names), pose, observer.startswith("-"))


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    frames = draw(st.integers(1, 4))
    observers = draw(st.sampled_from([("1",), ("1", "2"), ("1", "-1"), ("1", "2", "-1", "-2")]))
    drawn = tuple(draw(views(observer, frames)) for observer in observers)
    return Recording("log", "v2xpnp", 0.1, frames, drawn, HdMap(), tuple(o for o in observers if not o.startswith("-")))


@pytest.mark.slow
@given(recordings())
@settings(max_examples=examples(15, 60), deadline=None)
def test_what_is_written_is_read(written: Recording) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_views(written, Path(folder) / "log")
        read = read_v2xpnp(Path(folder) / "log", ())
        for file in Path(folder).glob("log/*/*.yaml"):  # the layout is PyYAML's own, as in the real files
            assert yaml.dump(yaml.safe_load(file.read_text())) == file.read_text()
    assert (read.id, read.dt_s, read.frame_count, read.cavs) == ("log", 0.1, written.frame_count, written.cavs)
    for before, after in zip(written.views, read.views, strict=True):
        assert (after.observer, after.is_infrastructure) == (before.observer, before.is_infrastructure)
        np.testing.assert_allclose(after.pose[:, :2], before.pose[:, :2], atol=HALF_MM)
        np.testing.assert_allclose(wrap_angles(after.pose[:, 2] - before.pose[:, 2]), 0, atol=math.radians(HALF_MM))
        found = {track.id: track for track in after.tracks}
        assert found.keys() == {track.id for track in before.tracks}
        for one in before.tracks:
            same_tracks(one, found[one.id])


def test_unknown_sizes_and_yaws(tmp_path: Path) -> None:
    nothing = np.full(FRAMES, np.nan)
    walker = replace(
        track("7", 1.0, 2.0, category=ObjectCategory.PEDESTRIAN), yaw=nothing, length=nothing, width=nothing
    )
    truth = scene(track("3", 0.0, 0.0), walker, cavs=("3",))
    write_v2xpnp(truth, tmp_path / "log", None, 0)
    (found,) = read_v2xpnp(tmp_path / "log", ()).views[0].tracks
    assert found.id == "7"
    assert np.isnan(found.length).all()
    assert (found.yaw == 0).all()
    assert simulate_observers(truth, ObservationNoise(), 0).views[0].tracks[0].id == "7"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda r: replace(r, dt_s=0.2), "frames 0.1 s apart, not 0.2 s"),
        (lambda r: replace(r, views=(replace(r.views[0], observer="log"),)), "not those of view 'log'"),
        (lambda r: replace(r, views=(ObserverView("1", (track("a", 0, 0),), np.zeros((FRAMES, 3))),)), "view '1'"),
    ],
)
def test_what_the_format_cannot_say_is_refused(tmp_path: Path, spoil: Any, message: str) -> None:
    good = Recording(
        "a", "test", 0.1, FRAMES, (ObserverView("1", (track("5", 0, 0),), np.zeros((FRAMES, 3))),), HdMap()
    )
    write_views(good, tmp_path / "good")
    with pytest.raises(ValueError, match=message):
        write_views(spoil(good), tmp_path / "bad")
    assert not (tmp_path / "bad").exists()


@pytest.mark.slow
def test_a_log_of_four_agents_and_84_actors_is_read_in_seconds(tmp_path: Path) -> None:
    rows = np.random.default_rng(0).uniform(-60, 60, (84, 2))
    crowd = [track(str(n), x, y) for n, (x, y) in enumerate(rows.tolist())]
    truth = scene(*crowd, cavs=("0", "1"), stations=((0.0, 0.0, 0.0), (9.0, 9.0, 0.0)))
    write_v2xpnp(truth, tmp_path / "log", None, 0)
    begin = time.perf_counter()
    read = read_v2xpnp(tmp_path / "log", ())
    assert (time.perf_counter() - begin) * 100 / FRAMES < 10.0
    assert sum(int(one.valid.sum()) for view in read.views for one in view.tracks) == FRAMES * (4 * 84 - 2)


@pytest.mark.slow
@needs_data
def test_a_real_log_and_its_map_are_read_back_unchanged(tmp_path: Path) -> None:
    real = read_scenarionet(REAL)
    cars = [one for one in real.views[0].tracks if one.valid.all() and one.category is ObjectCategory.CAR]
    cav = max(cars, key=lambda one: math.dist(one.xy[0], one.xy[-1]))
    truth = replace(real, dt_s=0.1, cavs=(cav.id,))
    ids = write_v2xpnp(truth, tmp_path / "log", None, 0)
    names = write_vector_map(real.map, tmp_path / "m.pkl")
    read = read_v2xpnp(tmp_path / "log", tmp_path / "m.pkl")
    found = by_id(read.views[0])
    assert len(found) == len(real.views[0].tracks) - 1 > 10
    for one in real.views[0].tracks:
        if one is not cav:
            np.testing.assert_allclose(found[ids[one.id]].xy, one.xy, atol=HALF_MM)
    assert len(read.map.lanes) == len(real.map.lanes)
    for lane in real.map.lanes.values():
        np.testing.assert_array_equal(read.map.lanes[names[lane.id]].centre, lane.centre)


# --- against the real thing
def outline(path: Path) -> tuple[str, set[str]]:
    """Head and objects of a frame file, every value replaced by its type: what is left is keys, order and layout."""
    text = re.sub(r"-?[0-9]+\.[0-9]+(e-?[0-9]+)?$", "FLOAT", path.read_text(), flags=re.MULTILINE)
    text = re.sub(r"^  [0-9]+:$", "  ID:", text, flags=re.MULTILINE)
    text = re.sub(r"obj_type: [A-Z][A-Za-z]+$", "obj_type: LABEL", text, flags=re.MULTILINE)
    text = re.sub(r"attribute: (''|static)$", "attribute: WORD", text, flags=re.MULTILINE)
    head, *objects = text.split("  ID:\n")
    return head, set(objects)


def typed(value: object) -> object:
    """A loaded frame with types for values; all objects of a frame must be alike."""
    if isinstance(value, dict):
        if all(isinstance(key, int) for key in value):
            return {"id": {repr(typed(one)) for one in value.values()}}
        return {key: typed(one) for key, one in value.items()}
    return [typed(one) for one in value] if isinstance(value, list) else type(value).__name__


@pytest.mark.slow
@needs_data
def test_files_are_like_the_real_ones_key_by_key(tmp_path: Path) -> None:
    t = np.arange(FRAMES) * 0.1
    things = [track("0", 10 * t, 0.0), track("1", 30.0, 5.0, 1.0, parked=True), track("2", 9.0, t, 1.0)]
    walkers = [track("3", 20.0, 5 + t, category=ObjectCategory.PEDESTRIAN)]
    truth = scene(*things, *walkers, cavs=("0", "2"), stations=((5.0, 9.0, 1.0),))
    write_v2xpnp(truth, tmp_path / "log", ObservationNoise(), 0)
    real = sorted(EXCERPT.glob("*/*.yaml"))
    assert {path.parent.name for path in real} == {"1", "2", "-1"}
    assert {path.parent.name for path in (tmp_path / "log").glob("*/*.yaml")} == {"1", "2", "-1"}
    for path in real:
        written = tmp_path / "log" / path.parent.name / path.name
        assert written.is_file()  # six digits, from 000000 on
        head, objects = outline(written)
        real_head, real_objects = outline(path)
        assert head == real_head
        assert len(objects) == 1
        assert objects == real_objects
        assert typed(yaml.safe_load(written.read_text())) == typed(yaml.safe_load(path.read_text()))
    labels = {box["obj_type"] for path in real for box in yaml.safe_load(path.read_text())["vehicles"].values()}
    assert labels <= set(LABEL_BY_CATEGORY.values())

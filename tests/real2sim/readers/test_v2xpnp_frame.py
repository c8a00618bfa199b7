"""V2XPnP's frames: the fast path equals the YAML parser, and truncation is detected."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.shared_material import needs_data
from testing.v2xpnp_samples import EXCERPT, frame, log, thing

from mdrive_sumo.core.errors import InputError
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_frame import _parse_regular, _parse_yaml, read_frame


def test_first_frame_may_have_any_number(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"1": [frame(), frame()], "2": [frame(), frame()]})
    for agent in "12":
        (folder / agent / "000000.yaml").rename(folder / agent / "000002.yaml")
    assert read_v2xpnp(folder, ()).frame_count == 2


numbers = st.one_of(
    st.integers(-1000, 1000), st.floats(-1e6, 1e6), st.floats(-1000, 1000).map(lambda v: round(v, 3)), st.just(1e-7)
)


triples = st.lists(numbers, min_size=3, max_size=3)


things = st.fixed_dictionaries(
    {
        "angle": triples,
        "attribute": st.sampled_from(["", "static"]),
        "center": triples,
        "extent": triples,
        "location": triples,
        "obj_type": st.sampled_from(["Car", "Pedestrian", "No", "TRUE", "Traffic Cone", "cone", "Off", "TrashCan"]),
    },
    optional={"speed": numbers},
)


frames = st.fixed_dictionaries(
    {
        "ego_speed": st.just(0),
        "infra": st.booleans(),
        "lidar_pose": st.lists(numbers, min_size=6, max_size=6),
        "true_ego_pose": st.lists(numbers, min_size=6, max_size=6),
        "vehicles": st.dictionaries(st.integers(0, 500), things, max_size=5),
    },
    optional={"cam1_left": st.fixed_dictionaries({"cords": triples, "extrinsic": st.lists(triples, max_size=4)})},
)


@pytest.mark.slow
@given(frames)
@settings(max_examples=examples(37, 150), deadline=None)
def test_fast_path_is_the_yaml_parser(raw: dict[str, Any]) -> None:
    text = yaml.dump(raw)
    fast, slow = _parse_regular(text), _parse_yaml(Path("f.yaml"), text)
    if any(v["obj_type"] in ("No", "TRUE", "Off", "Traffic Cone", "cone") for v in raw["vehicles"].values()):
        assert fast is None
        return
    assert fast is not None
    assert (fast.infrastructure, fast.sensor, fast.ids) == (slow.infrastructure, slow.sensor, slow.ids)
    assert (fast.labels, fast.static) == (slow.labels, slow.static)
    np.testing.assert_array_equal(fast.boxes, slow.boxes)


@pytest.mark.parametrize("bare", ["No", "TRUE", "Off", "Null"])
def test_labels_that_yaml_takes_for_something_else(bare: str) -> None:
    text = frame({1: thing()}).replace("Car", bare)
    assert _parse_regular(text) is None
    assert _parse_yaml(Path("f.yaml"), text).labels == (str(yaml.safe_load(bare)),)


def test_other_layouts_are_read_too(tmp_path: Path) -> None:
    box = "{location: [1, 2, 0], extent: [2, 1, 1], angle: [0, 9, 0], obj_type: Car}"
    text = f"lidar_pose: [1, 2, 3, 4, 5, 6]\nvehicles: {{7: {box}}}\n"
    assert _parse_regular(text) is None
    (tmp_path / "f.yaml").write_text(text)
    read = read_frame(tmp_path / "f.yaml")
    assert (read.ids, read.labels, read.static, read.infrastructure) == (("7",), ("Car",), (False,), False)
    assert read.boxes.tolist() == [[0, 9, 0, 0, 0, 0, 2, 1, 1, 1, 2, 0]]


@pytest.mark.parametrize("vehicles", ["vehicles:\n", "vehicles: {}\n", "", "vehicles: null\n"])
def test_a_frame_may_be_empty(tmp_path: Path, vehicles: str) -> None:
    (tmp_path / "f.yaml").write_text("lidar_pose: [1, 2, 3, 4, 5, 6]\n" + vehicles)
    assert read_frame(tmp_path / "f.yaml").ids == ()


@pytest.mark.slow
def test_every_truncation_shows_unless_whole_objects_are_gone(tmp_path: Path) -> None:
    text = frame({7: thing(1.0, 2.0), 8: thing(3.0, 4.0), 9: thing(5.0, 6.0)})
    file = tmp_path / "f.yaml"
    silent: list[str] = []
    for cut in range(len(text)):
        file.write_text(text[:cut])
        try:
            read_frame(file)
        except InputError as error:
            assert str(file) in str(error)
        else:
            silent.append(text[:cut].splitlines()[-1].strip())
    # only a file that is complete without its rest: a pose and no objects, or fewer of them
    assert silent == ["- 2.0", "- 2.0", "vehicles:", "obj_type: Car", "obj_type: Car"]


# --- real frames
@pytest.fixture
def first_frames(tmp_path: Path) -> Path:
    """The first frame of each agent of the real log, which has holes after it."""
    for agent in ("1", "2", "-1"):
        (tmp_path / "log" / agent).mkdir(parents=True)
        (tmp_path / "log" / agent / "000000.yaml").symlink_to(EXCERPT / agent / "000000.yaml")
    return tmp_path / "log"


@needs_data
def test_real_frames(first_frames: Path) -> None:
    """What the format notes tell of these frames, measured by others."""
    read = read_v2xpnp(first_frames, ())
    views = {view.observer: {track.id: track for track in view.tracks} for view in read.views}
    assert {name: len(view) for name, view in views.items()} == {"1": 20, "2": 18, "-1": 15}
    poses = {view.observer: view.pose[0] for view in read.views}
    for observer, other, ghost in (("1", "2", "7"), ("2", "1", "30")):
        assert ghost not in views[other]
        assert 0.4 < math.dist(views[observer][ghost].xy[0], poses[other][:2]) < 1.0
    shared = views["1"].keys() & views["2"].keys()
    assert len(shared) == 15
    gaps = [math.dist(views["1"][k].xy[0], views["2"][k].xy[0]) for k in shared]
    assert np.median(gaps) < 0.15
    assert read.notes == ("no vector map given",)


@needs_data
def test_real_frames_have_the_regular_layout() -> None:
    for path in EXCERPT.glob("*/*.yaml"):
        text = path.read_text()
        fast, slow = _parse_regular(text), _parse_yaml(path, text)
        assert fast is not None
        assert (fast.ids, fast.sensor, fast.labels, fast.static) == (slow.ids, slow.sensor, slow.labels, slow.static)
        np.testing.assert_array_equal(fast.boxes, slow.boxes)


@pytest.mark.parametrize(
    "text", ["[" * 200_000 + "\n", "- " * 200_000 + "1\n", "".join(f"{' ' * n}a:\n" for n in range(1500))]
)
def test_values_nested_deeper_than_the_stack_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "000000.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"000000\.yaml: expected values at most 1000 deep, found more"):
        read_frame(path)


def test_many_flat_lists_are_read(tmp_path: Path) -> None:
    objects = "".join(
        f"  {n}: {{angle: [0, 0, 0], extent: [1, 1, 1], location: [{n}, 0, 0], obj_type: Car}}\n" for n in range(400)
    )
    path = tmp_path / "000000.yaml"
    path.write_text(f"lidar_pose: [0, 0, 0, 0, 0, 0]\nvehicles:\n{objects}")
    assert len(read_frame(path).ids) == 400

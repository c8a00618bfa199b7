"""V2XPnP logs: tracks, labels and damaged folders."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from testing.shared_material import needs_data
from testing.v2xpnp_samples import EXCERPT, POSE, cut, frame, log, thing

from mdrive_sumo.core.errors import InputError
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.readers.v2xpnp_frame import CATEGORY_BY_LABEL
from real2sim.recording import ObjectCategory


def test_units_and_frames(tmp_path: Path) -> None:
    turned = frame({7: thing(1.0, 2.0, center=[0.5, -0.25, 0])}, pose=[1, 2, 3, 4, -180, 6])
    station = frame({}, infra=True, pose=[5.0, 6.0, 7.0, 0.0, 45.0, 0.0])
    read = read_v2xpnp(log(tmp_path / "2023_1_0", {"1": [frame(), turned], "-1": [station, station]}), ())
    assert (read.id, read.source, read.dt_s, read.frame_count, read.cavs) == ("2023_1_0", "v2xpnp", 0.1, 2, ("1",))
    cav, infra = read.views
    assert (cav.observer, cav.is_infrastructure, infra.observer, infra.is_infrastructure) == ("1", False, "-1", True)
    np.testing.assert_allclose(cav.pose, [[10, 20, math.pi / 2], [1, 2, -math.pi]])
    np.testing.assert_allclose(infra.pose, [[5, 6, math.pi / 4]] * 2)
    (car,) = cav.tracks
    np.testing.assert_allclose(car.xy, [[1, 2], [1.5, 1.75]])
    np.testing.assert_allclose(car.yaw, math.radians(30))
    np.testing.assert_allclose((car.length[0], car.width[0]), (4.5, 1.9))
    assert (car.id, car.category, car.parked, infra.tracks) == ("7", ObjectCategory.CAR, False, ())
    assert read.notes == ("no vector map given",)


def test_frames_without_the_object_are_invalid(tmp_path: Path) -> None:
    texts = [frame(), frame({3: thing(5.0, 5.0)}), frame({3: thing(6.0, 5.0), 7: thing(1.5, 2.0)})]
    first, second = read_v2xpnp(log(tmp_path / "a", {"1": texts}), ()).views[0].tracks
    assert (first.id, first.valid.tolist(), second.id, second.valid.tolist()) == (
        *("7", [True, False, True]),
        *("3", [False, True, True]),
    )
    for column in (first.x, first.y, first.yaw, first.length, first.width):
        assert np.isnan(column).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("label", "category"),
    [
        ("Car", ObjectCategory.CAR),
        ("PoliceCar", ObjectCategory.CAR),
        ("Van", ObjectCategory.VAN),
        ("Truck", ObjectCategory.TRUCK),
        ("LongVehicle", ObjectCategory.TRUCK),
        ("ConcreteTruck", ObjectCategory.TRUCK),
        ("Bus", ObjectCategory.BUS),
        ("Motorcycle", ObjectCategory.MOTORCYCLE),
        ("BicycleRider", ObjectCategory.BICYCLE),
        ("Cyclist", ObjectCategory.BICYCLE),
        ("Scooter", ObjectCategory.BICYCLE),
        ("Pedestrian", ObjectCategory.PEDESTRIAN),
        ("Child", ObjectCategory.PEDESTRIAN),
        ("TrashCan", ObjectCategory.STATIC),
        ("traffic_cone", ObjectCategory.STATIC),
    ],
)
def test_known_labels(tmp_path: Path, label: str, category: ObjectCategory) -> None:
    read = read_v2xpnp(log(tmp_path / "a", {"1": [frame({1: thing(obj_type=label)})]}), ())
    assert read.views[0].tracks[0].category is category
    assert read.notes == ("no vector map given",)


@pytest.mark.parametrize(
    ("half_length", "category"),
    [
        (0.3, ObjectCategory.PEDESTRIAN),
        (0.9, ObjectCategory.BICYCLE),
        (2.2, ObjectCategory.CAR),
        (6.0, ObjectCategory.TRUCK),
    ],
)
def test_unknown_labels_are_noted_and_classed_by_size(
    tmp_path: Path, half_length: float, category: ObjectCategory
) -> None:
    text = frame({1: thing(obj_type="Zeppelin", extent=[half_length, 0.3, 1.0])})
    read = read_v2xpnp(log(tmp_path / "a", {"1": [text]}), ())
    assert read.views[0].tracks[0].category is category
    assert "agent 1: 1 objects of unknown type 'Zeppelin' classed by size" in read.notes


def test_majority_decides_label_and_attribute(tmp_path: Path) -> None:
    texts = [frame({1: thing(obj_type=label, attribute=a)}) for label, a in (("Van", ""), *[("Car", "static")] * 2)]
    read = read_v2xpnp(log(tmp_path / "a", {"1": texts}), ())
    (track,) = read.views[0].tracks
    assert (track.category, track.parked) == (ObjectCategory.CAR, True)
    assert any(note.startswith("agent 1: object 1 changes its type") for note in read.notes)


def test_size_zero_is_unknown(tmp_path: Path) -> None:
    (track,) = read_v2xpnp(log(tmp_path / "a", {"1": [frame({1: thing(extent=[0, 0.5, 0])})]}), ()).views[0].tracks
    assert np.isnan(track.length[0])
    assert track.width[0] == 1.0


def test_other_yaml_files_are_skipped(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"1": [frame()]})
    for name in ("000000_additional.yaml", "000001_camera_gt.yaml", "data_protocol.yaml"):
        (folder / "1" / name).write_text("nothing of ours")
    assert read_v2xpnp(folder, ()).frame_count == 1


Spoil = Callable[[Path], object]


BAD: dict[str, tuple[Spoil, str]] = {
    "truncated YAML": (
        lambda f: (f / "1/000001.yaml").write_text(cut(frame())),
        "1/000001.yaml: expected a last line with its end",
    ),
    "cut within an object": (
        lambda f: (f / "1/000001.yaml").write_text(frame().split("    location:")[0]),
        "000001.yaml: object 7: expected obj_type, found only angle, attribute, center, extent",
    ),
    "object without place": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("location", "place")),
        "000001.yaml: object 7: location: expected 3 numbers, found None",
    ),
    "no YAML": (
        lambda f: (f / "1/000001.yaml").write_text("a: [1, 2\n"),
        "000001.yaml: expected well-formed YAML, found",
    ),
    "not text": (lambda f: (f / "1/000001.yaml").write_bytes(b"\xff\xfe\n"), "expected UTF-8 text"),
    "empty file": (lambda f: (f / "1/000001.yaml").write_text(""), "expected a last line"),
    "a list": (lambda f: (f / "1/000001.yaml").write_text("- 1\n"), "expected a mapping with lidar_pose"),
    "a YAML tag": (
        lambda f: (f / "1/000001.yaml").write_text("!!python/object/apply:os.system [exit]\n"),
        "expected well-formed YAML, found: could not determine a constructor",
    ),
    "no pose": (
        lambda f: (f / "1/000001.yaml").write_text("vehicles: {}\n"),
        "lidar_pose: expected 6 numbers, found None",
    ),
    "NaN pose": (
        lambda f: (f / "1/000001.yaml").write_text(frame(pose=[math.nan, *POSE[1:]])),
        "000001.yaml: lidar_pose: expected finite numbers, found [nan",
    ),
    "NaN box": (
        lambda f: (f / "1/000001.yaml").write_text(frame({9: thing(math.nan)})),
        "000001.yaml: object 9: location: expected finite numbers, found nan",
    ),
    "infinite box": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("- 2.25", "- 1.5e+400")),
        "object 7: extent: expected finite numbers, found inf",
    ),
    "text as number": (
        lambda f: (f / "1/000001.yaml").write_text(frame().replace("- 30.0", "- north")),
        "object 7: angle: expected 3 numbers, found [1.0, 'north', 2.0]",
    ),
    "object is a number": (
        lambda f: (f / "1/000001.yaml").write_text(frame({7: 5})),
        "object 7: expected a mapping with location, found 5",
    ),
    "vehicles is a list": (
        lambda f: (f / "1/000001.yaml").write_text(frame(vehicles=[1])),
        "vehicles: expected a mapping of objects, found list",
    ),
    "a long hole": (
        lambda f: (f / "1/000023.yaml").write_text(frame()),
        "1: expected at most 19 missing frames in a row, found none between 000002.yaml and 000023.yaml",
    ),
    "missing agent": (lambda f: (f / "1").rename(f / "9"), "expected agent folders without holes, found [2, 9]"),
    "missing station": (lambda f: (f / "2").rename(f / "-2"), "found [-2, 1] and no folder -1"),
    "empty agent folder": (lambda f: (f / "3").mkdir(), "3: expected frames 000000.yaml"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BAD)
def test_bad_logs(tmp_path: Path, case: str) -> None:
    folder = log(tmp_path / "a", {"1": [frame()] * 3, "2": [frame()] * 3})
    assert read_v2xpnp(folder, ()).frame_count == 3
    spoil, message = BAD[case]
    spoil(folder)
    with pytest.raises(InputError) as caught:
        read_v2xpnp(folder, ())
    assert message in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_frames_that_an_agent_lacks_are_not_observed_by_it(tmp_path: Path) -> None:
    """A hole, a late begin and an early end; the log lasts as long as any agent."""
    folder = log(tmp_path / "a", {"1": [frame({7: thing(float(k), 2.0)}) for k in range(8)], "2": [frame()] * 8})
    (folder / "1/000003.yaml").unlink()
    for number in (0, 1, 7):
        (folder / f"2/{number:06d}.yaml").unlink()
    read = read_v2xpnp(folder, ())
    one, other = read.views
    assert read.frame_count == 8
    assert np.isfinite(one.pose[:, 0]).tolist() == [True] * 3 + [False] + [True] * 4
    assert np.isfinite(other.pose[:, 0]).tolist() == [False, False, *[True] * 5, False]
    (seen,) = one.tracks
    assert seen.valid.tolist() == [True] * 3 + [False] + [True] * 4
    np.testing.assert_allclose(seen.x, [0, 1, 2, np.nan, 4, 5, 6, 7])
    assert read.notes[:3] == (
        "agent 1 lacks 1 frames: 000003; its own pose and what no other agent sees are interpolated there",
        "agent 2 begins late, 0.2 s after the log, with frame 000002",
        "agent 2 ends early, 0.1 s before the log, with frame 000006",
    )


def test_no_agents(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected agent folders 1, 2, \.\.\. of CAVs, found none"):
        read_v2xpnp(tmp_path, ())
    with pytest.raises(InputError, match="expected a folder"):
        read_v2xpnp(tmp_path / "nowhere", ())


def test_agents_may_be_chosen(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"2": [frame()], "-2": [frame(infra=True)], "7": []})
    assert [view.observer for view in read_v2xpnp(folder, (), agents=("2", "-2")).views] == ["2", "-2"]
    with pytest.raises(InputError, match="5: expected an agent folder"):
        read_v2xpnp(folder, (), agents=("2", "5"))


@needs_data
def test_real_excerpt_has_holes() -> None:
    read = read_v2xpnp(EXCERPT, ())
    assert read.frame_count == 11
    assert "agent 1 lacks 9 frames: 000001, 000002" in " ".join(read.notes)
    assert "agent 2 ends early, 1.0 s before the log, with frame 000000" in read.notes


def test_labels_are_normalised() -> None:
    assert all(label.isalpha() and label == label.lower() for label in CATEGORY_BY_LABEL)

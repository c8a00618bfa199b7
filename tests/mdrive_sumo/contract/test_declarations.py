"""What agents declare: label, sensors, camera rigs; and which sensing track follows for a run."""

from itertools import permutations

import numpy as np
import pytest

from mdrive_sumo.contract import (
    LABELS,
    Detections,
    Objects,
    SensorSpec,
    check_sensors,
    join_sensing_tracks,
    read_label,
    read_sensors,
    schema,
)
from mdrive_sumo.contract.camera_rigs import RIGS, build_camera_rig
from mdrive_sumo.core.errors import InputError


class Declares:
    def __init__(self, sensors: object) -> None:
        self._sensors = sensors

    def sensors(self) -> object:
        return self._sensors


def test_sensors_are_a_sequence_of_specs() -> None:
    specs = [SensorSpec("objects"), SensorSpec("lidar", "top")]
    assert read_sensors(Declares(specs)) == check_sensors(tuple(specs)) == tuple(specs)  # pyright: ignore[reportArgumentType]
    assert check_sensors([]) == ()


@pytest.mark.parametrize(
    ("sensors", "sentence"),
    [
        (None, "sensors(): expected a tuple of SensorSpec, found NoneType"),
        ({"objects"}, "sensors(): expected a tuple of SensorSpec, found set"),
        ("objects", "sensors(): expected a tuple of SensorSpec, found str"),
        (SensorSpec("objects"), "sensors(): expected a tuple of SensorSpec, found SensorSpec"),
        ((SensorSpec("objects"), "lidar"), "sensors(): expected a tuple of SensorSpec, found 'lidar' in it"),
        (
            (SensorSpec,),
            "sensors(): expected a tuple of SensorSpec, found <class 'mdrive_sumo.contract.sensors.SensorSpec'> in it",
        ),
    ],
)
def test_other_sensors_are_one_sentence(sensors: object, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        check_sensors(sensors)
    assert str(caught.value) == sentence


def test_a_label_is_text_and_must_be_there() -> None:
    class Labelled:
        label = "sharing"

    assert read_label(Labelled()) in LABELS
    with pytest.raises(InputError, match=r"agent Declares: expected an attribute `label`, one of single, .*add `label"):
        read_label(Declares(()))


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_is_the_papers_at_any_scale(name: str) -> None:
    """Ids differ, images keep their shape, and the horizontal angle of view does not depend on the scale."""
    full, half = build_camera_rig(name), build_camera_rig(name, 0.5, "semantic", every_ticks=4)
    assert len({spec.id for spec in full}) == len(full) == len(RIGS[name])
    for camera, large, small in zip(RIGS[name], full, half, strict=True):
        assert (large.kind, large.id) == (small.kind, small.id) == ("camera", camera.id)
        assert (large.options["width"], large.options["height"]) == camera.size
        assert (small.options["width"], small.options["height"]) == tuple(round(side / 2) for side in camera.size)
        sides = {name: small.options[name] for name in ("width", "height")}
        assert {**small.options, "kind": "rgb", "every_ticks": 1} == {**large.options, **sides}
        assert (small.options["kind"], small.options["every_ticks"]) == ("semantic", 4)


def test_no_image_is_smaller_than_16_pixels() -> None:
    assert {spec.options["width"] for spec in build_camera_rig("hitl", 1e-6)} == {16}


@pytest.mark.parametrize(
    ("name", "scale", "sentence"),
    [
        ("sedan", 1.0, "camera rig 'sedan': expected one of tcp, uniad, vad, "),
        ("tcp", 0.0, r"camera rig 'tcp': scale: expected a number in \(0, 1\], found 0.0"),
        ("tcp", 1.5, r"expected a number in \(0, 1\], found 1.5"),
        ("tcp", float("nan"), r"expected a number in \(0, 1\], found nan"),
    ],
)
def test_a_bad_rig_is_one_sentence(name: str, scale: float, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        build_camera_rig(name, scale)


@pytest.mark.parametrize(
    ("tracks", "joined"),
    [
        (("sensor",), "sensor"),
        (("sensor", "sensor"), "sensor"),
        (("sensor", "object"), "object"),
        (("object", ""), "object"),
        (("sensor", ""), ""),
        (("", ""), ""),
        ((), ""),
    ],
)
def test_one_car_with_objects_makes_a_run_of_objects(tracks: tuple[str, ...], joined: str) -> None:
    assert {join_sensing_tracks(order) for order in permutations(tracks)} == {joined}


def test_objects_as_detections_keep_their_order_and_places() -> None:
    columns = [np.array(pair) for pair in ((1.0, 2.0), (3.0, 4.0), (0.1, 0.2), (5.0, 6.0), (4.5, 1.8), (2.0, 0.6))]
    x, y, yaw, _, length, width = columns
    detections = Detections.from_objects(Objects(("near", "far"), np.zeros(2, np.uint8), *columns))
    assert np.array_equal(detections.boxes, np.stack((x, y, yaw, length, width), axis=1))
    assert detections.scores.tolist() == [1.0, 1.0]
    none = Detections.from_objects(Objects((), np.zeros(0, np.uint8), *(np.zeros(0) for _ in range(6))))
    assert none.boxes.shape == (0, 5) and none.scores.shape == (0,)


def test_the_schema_names_each_type_that_it_uses() -> None:
    types = schema()["types"]
    named = {
        word
        for about in types.values()
        for text in about["fields"].values()
        for word in text.replace("|", " ").replace("[", " ").replace("]", " ").replace(",", " ").split()
    }
    assert types["JunctionControl"]["fields"]["kind"].startswith('"traffic-light" | "priority-road" | ')
    named = {word for word in named if not word.startswith('"')}  # a value, no type
    scalars = {"float", "int", "str", "bool", "bytes", "null", "array", "tuple", "Mapping", "float64", "float32"}
    assert named - set(types) <= scalars | {"uint8", "int32"}
    assert all(about["description"] for about in types.values())

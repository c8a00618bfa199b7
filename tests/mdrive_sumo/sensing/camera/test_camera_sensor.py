"""Cameras as sensors: options, rates, names, light, noise, blur, rigs."""

import math

import numpy as np
import pytest
from testing.camera_scenes import build_camera, build_scene, find_eye, load_town, needs_opengl, place_car, take_image

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.contract.camera_rigs import RIGS, build_camera_rig
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.camera.lighting import LIGHT_OF_WEATHER, LIGHTS
from mdrive_sumo.sensing.sensing_frame import SensingFrame, derive_track_name
from mdrive_sumo.sensing.sensor_kinds import BUDGET_MS, find_object_source, price_sensor


def street_scene(tick: int = 0) -> SensingFrame:
    """A CAV on a street of the town with a car 12 m ahead."""
    lane = max(load_town().driving, key=lambda one: one.centre.length)
    (x, y), yaw = lane.centre.at(10.0), lane.centre.yaw_at(10.0)
    return build_scene([place_car(x, y, yaw), place_car(x + 12 * math.cos(yaw), y + 12 * math.sin(yaw), yaw)], tick)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"kind": "thermal"}, "expected one of rgb, semantic, depth, instance"),
        ({"width": 8}, "'width'"),
        ({"width": 100.5}, "whole number"),
        ({"height": 5000}, "'height'"),
        ({"fov_deg": 180.0}, "'fov_deg'"),
        ({"z": 0.0}, "'z'"),
        ({"pitch_deg": float("nan")}, "'pitch_deg'"),
        ({"x": "front"}, "'x'"),
    ],
)
def test_unusable_options_are_one_sentence(options: dict[str, float | str], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        read_camera_model(SensorSpec("camera", options=options))
    assert "\n" not in str(caught.value)


@needs_opengl
@pytest.mark.parametrize(
    "options",
    [{"colour": 1.0}, {"light": "moon"}, {"noise": 2.0}, {"every_ticks": 0}, {"on_ticks": 3, "cycle_ticks": 2}],
)
def test_other_options_are_checked_too(options: dict[str, float | str]) -> None:
    with pytest.raises(InputError, match="sensor 'camera'"):
        build_camera(load_town(), **options)


@needs_opengl
def test_a_slow_camera_is_missing_between_its_images() -> None:
    camera = build_camera(load_town(), every_ticks=4, width=32, height=32)
    taken = [camera.sense(scene, find_eye(scene)) is not None for scene in map(street_scene, range(9))]
    assert [tick for tick, image in enumerate(taken) if image] == [0, 4, 8]


@needs_opengl
def test_a_camera_that_works_in_turns_rests_between_them() -> None:
    camera = build_camera(load_town(), every_ticks=2, on_ticks=5, cycle_ticks=12, cycle_start=4, width=32, height=32)
    taken = [camera.sense(scene, find_eye(scene)) is not None for scene in map(street_scene, range(24))]
    assert [tick for tick, image in enumerate(taken) if image] == [4, 6, 8, 16, 18, 20]


@needs_opengl
def test_an_instance_has_the_name_of_other_sensors_and_the_own_car_is_not_shown() -> None:
    image = take_image(street_scene(), load_town(), kind="instance")
    assert image.names == (derive_track_name("me", "o1", 3),)
    assert set(np.unique(image.pixels).tolist()) == {-1, 0}
    assert image.pixels.dtype == np.int32 and image.pixels.shape == (224, 400)


@needs_opengl
def test_images_are_the_same_in_every_run_and_noise_depends_on_the_seed() -> None:
    roads, scene = load_town(), street_scene()
    first, again = (take_image(scene, roads).pixels for _ in range(2))
    assert first.dtype == np.uint8 and first.shape == (224, 400, 3)
    assert (first == again).all()
    noisy, same, other = (
        build_camera(roads, seed=seed, noise=0.05).sense(scene, find_eye(scene)) for seed in (1, 1, 2)
    )
    assert noisy is not None and same is not None and other is not None
    assert (noisy.pixels == same.pixels).all() and (noisy.pixels != other.pixels).any()
    assert np.abs(noisy.pixels.astype(float) - first).mean() == pytest.approx(255 * 0.05 * 0.8, rel=0.25)


@needs_opengl
def test_light_follows_the_weather() -> None:
    roads, scene = load_town(), street_scene()
    brightness = {name: take_image(scene, roads, light=name).pixels.mean() for name in LIGHTS}
    assert brightness["night"] < 0.5 * brightness["dusk"] < 0.5 * brightness["day"]
    for weather, light in LIGHT_OF_WEATHER.items():
        image = build_camera(roads, weather=weather).sense(scene, find_eye(scene))
        assert image is not None and image.pixels.mean() == brightness[light]
    assert take_image(scene, roads, exposure=0.5).pixels.mean() < 0.6 * brightness["day"]


@needs_opengl
def test_motion_blurs_what_passes_and_nothing_at_rest() -> None:
    roads, scene = load_town(), street_scene()
    me = scene.egos["me"]
    still = SensingFrame(0, scene.boxes, {"me": EgoState(me.x, me.y, me.yaw, 0.0)})
    sharp = take_image(scene, roads).pixels.astype(float)
    assert np.abs(take_image(still, roads, motion_blur_s=0.05).pixels - sharp).max() <= 1
    assert np.abs(take_image(scene, roads, motion_blur_s=0.05).pixels - sharp).max() > 20


@pytest.mark.parametrize("name", RIGS)
def test_rigs_are_those_of_the_paper(name: str) -> None:
    specs = build_camera_rig(name)
    assert len({spec.id for spec in specs}) == len(specs)
    assert all(read_camera_model(spec).width == dict(spec.options)["width"] for spec in specs)
    half = build_camera_rig(name, 0.5)
    assert [round(float(spec.options["width"]) / 2) for spec in specs] == [spec.options["width"] for spec in half]


def test_unknown_rigs_are_one_sentence() -> None:
    with pytest.raises(InputError, match="expected one of tcp, uniad"):
        build_camera_rig("radar")
    with pytest.raises(InputError, match=r"in \(0, 1\]"):
        build_camera_rig("vad", 2.0)


def test_a_labelled_image_is_a_list_of_objects() -> None:
    assert find_object_source(build_camera_rig("vad")) == ""
    assert find_object_source(build_camera_rig("vad", kind="depth")) == ""
    assert "instance" in find_object_source(build_camera_rig("vad", kind="instance"))


def test_prices_grow_with_the_image_and_fall_with_the_rate() -> None:
    small, large = (price_sensor(SensorSpec("camera", options={"width": side, "height": side})) for side in (100, 400))
    assert small < large < BUDGET_MS
    slow = SensorSpec("camera", options={"width": 400, "height": 400, "every_ticks": 4})
    assert price_sensor(slow) == pytest.approx(large / 4)
    blurred = SensorSpec("camera", options={"width": 400, "height": 400, "motion_blur_s": 0.02})
    assert price_sensor(blurred) == pytest.approx(4 * large)
    assert price_sensor(SensorSpec("camera", options={"width": "wide"})) > large
    assert sum(map(price_sensor, build_camera_rig("vad", 0.5))) < BUDGET_MS

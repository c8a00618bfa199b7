"""Inputs of networks: names, shapes and contents; instructions; LiDAR histograms."""

import hashlib
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from testing.learned_samples import make_briefing, make_observation

from mdrive_sumo.agents.learned import instructions
from mdrive_sumo.agents.learned.instructions import VOCABULARY, compose_instruction, encode_instruction
from mdrive_sumo.agents.learned.navigation import Navigation, RouteNavigator
from mdrive_sumo.agents.learned.network_inputs import (
    black_out_images,
    build_inputs,
    build_lidar_histogram,
    compute_motion,
    describe_inputs,
    has_sensor_data,
)
from mdrive_sumo.agents.learned.system_spec import COMMANDS, INSTRUCTION_WORDS, LIDAR_CELLS, SYSTEMS
from mdrive_sumo.contract import OwnState, PointCloud

ROUTE = np.column_stack((np.arange(101.0), np.zeros(101)))
VOCABULARY_CHECKSUM = "9dcae18eb8805c68"
"""Of the words that the packaged weights of the counterpart of LMDrive were trained with."""


def navigate() -> Navigation:
    return RouteNavigator(make_briefing(ROUTE)).locate(OwnState(0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0))


def make_cloud(*points: tuple[float, float, float]) -> PointCloud:
    return PointCloud(np.array([(*p, 0.5) for p in points], np.float32).reshape(-1, 4), np.zeros(0, np.int32), ())


@pytest.mark.parametrize("name", SYSTEMS)
def test_inputs_have_the_described_names_shapes_and_types(name: str) -> None:
    spec = SYSTEMS[name]
    seen = make_observation(spec)
    inputs = build_inputs(spec, seen, navigate(), "Turn left ahead.")
    expected = {k: v for k, v in describe_inputs(spec).items() if k not in ("memory", "motion")}
    assert {k: (v.shape, str(v.dtype)) for k, v in inputs.items()} == expected and list(inputs) == list(expected)
    first = spec.images[0]
    assert [int(image.max()) for image in inputs[first.name]] == [100 + i for i in range(len(first.cameras))]
    assert inputs["navigation"][0] == pytest.approx(0.5)


@pytest.mark.parametrize("name", SYSTEMS)
def test_sensors_give_the_images_that_the_inputs_need(name: str) -> None:
    sizes = {
        spec.id: (spec.options["height"], spec.options["width"])
        for spec in SYSTEMS[name].build_sensors()
        if spec.kind == "camera"
    }
    wanted = {c: (image.height, image.width) for image in SYSTEMS[name].images for c in image.cameras}
    assert sizes == wanted


def test_a_decision_needs_every_image_and_the_scan() -> None:
    spec = SYSTEMS["lmdrive"]
    seen = make_observation(spec)
    assert has_sensor_data(spec, seen)
    assert not has_sensor_data(spec, replace(seen, lidar={}))
    assert not has_sensor_data(spec, replace(seen, cameras={k: v for k, v in seen.cameras.items() if k != "rear"}))


def test_blacked_out_images_leave_everything_else() -> None:
    spec = SYSTEMS["lmdrive"]
    inputs = build_inputs(spec, make_observation(spec), navigate(), "Turn left ahead.")
    black = black_out_images(spec, inputs)
    assert not black["front"].any() and not black["sides"].any() and inputs["front"].any()
    assert all(black[name] is inputs[name] for name in ("navigation", "lidar", "instruction"))


def test_motion_is_told_in_the_earlier_frame() -> None:
    found = compute_motion(np.array((10.0, 5.0, math.pi / 2)), np.array((9.0, 7.0, -math.pi + 0.1)))
    assert found.tolist() == pytest.approx([2.0, 1.0, math.pi / 2 + 0.1], abs=1e-6)


def test_points_fall_into_cells_ahead_left_and_by_height() -> None:
    cloud = make_cloud((0.1, -0.1, -2.5), (35.9, 23.9, -2.2), (35.9, 23.9, 0.0), (-11.9, -23.9, 0.0), (36.1, 0, 0))
    found = build_lidar_histogram(cloud)
    last = LIDAR_CELLS - 1
    assert found.sum() == 4
    assert found[0, 47, 32] == found[0, 0, 0] == found[1, 0, 0] == found[1, last, last] == 1


def test_counts_stop_at_255_and_an_empty_scan_has_none() -> None:
    assert build_lidar_histogram(make_cloud(*[(5.0, 0.0, -2.5)] * 300)).max() == 255
    assert not build_lidar_histogram(make_cloud()).any()


@pytest.mark.parametrize(("command", "notice"), [*product(range(len(COMMANDS)), ("", "stop", "goal"))])
def test_every_situation_has_paraphrases_that_fit(command: int, notice: str) -> None:
    place = replace(
        navigate(),
        command=command,
        stop_m=10.0 if notice == "stop" else 50.0,
        goal_m=10.0 if notice == "goal" else 90.0,
    )
    texts = {compose_instruction(place, variant) for variant in range(100)}
    assert len(texts) >= (6 if notice == "" else 36)
    for text in texts:
        words = instructions.split_words(text)
        encoded = encode_instruction(text)
        assert [VOCABULARY[n] for n in encoded[: len(words)]] == words and not encoded[len(words) :].any()


def test_unknown_words_and_long_texts() -> None:
    encoded = encode_instruction("Turn WIDDERSHINS, please! " + "road " * 40)
    assert encoded.shape == (INSTRUCTION_WORDS,) and encoded.dtype == np.int64
    assert [VOCABULARY[n] for n in encoded[:4]] == ["turn", "<unknown>", "please", "road"] and encoded.all()


def test_the_vocabulary_is_that_of_the_packaged_weights() -> None:
    assert hashlib.sha256(" ".join(VOCABULARY).encode()).hexdigest()[:16] == VOCABULARY_CHECKSUM

"""Agents behind detectors: what they share and fuse, a car behind a wall, objects with velocities, bad input."""

import importlib.util
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.lidar_scans import scan, sensor, town
from testing.planning import briefing
from testing.tiny_detector import save_tiny_detector

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes, decode_boxes
from mdrive_sumo.agents.learned.detection_tracker import DetectionTracker
from mdrive_sumo.agents.learned.detector_agent import OPTIONS, DetectorAgent
from mdrive_sumo.agents.learned.fusion_network import EncodedScan, load_detector
from mdrive_sumo.agents.learned.fusion_spec import (
    BOX_NUMBERS,
    CLASSES,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FUSIONS,
    LEAST_CONFIDENCE,
    MAP_TICKS,
    OUTPUT_CELLS,
    WAIT_TICKS,
)
from mdrive_sumo.agents.learned.shared_grids import build_feature_grid, encode_features
from mdrive_sumo.agents.registry import DETECTOR_AGENTS
from mdrive_sumo.contract import Briefing, Message, Objects, Observation, OwnState, Reply, check_reply
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.sensing.sensor_kinds import derive_sensing_track
from mdrive_sumo.v2x.content import MAX_PACKET_BYTES
from mdrive_sumo.v2x.messages import CAM, CPM, FEATURE, Feature, ReferencePose, decode, encode
from mdrive_sumo.vehicle.control import CONTROLLERS

PREFIX = "perception-swap:"
NAMES = tuple(name.removeprefix(PREFIX) for name in DETECTOR_AGENTS if name.startswith(PREFIX))
SHARING = tuple(name for name in NAMES if name != "none")
WEIGHTS = {name: "none" if name == "late" else name for name in NAMES}
ROADS = town(((8.0, -8.0), (40.0, -8.0), (40.0, -6.0), (8.0, -6.0)))
"""A wall between the own car and what lies south of it."""
HIDDEN = (Kind.VEHICLE, 25.0, -12.0, 0.0, 4.5, 2.0)
SEEN = (Kind.VEHICLE, 15.0, 10.0, 0.0, 4.5, 2.0)
POSES = {"a": (0.0, 0.0, 0.0), "b": (25.0, -30.0, math.pi / 2)}
"""The own car, and a sender that looks north to the hidden car."""


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("weights")
    for name in sorted({*WEIGHTS.values()}):
        save_tiny_detector(folder, name)
    return folder


def make_agent(folder: Path, name: str, about: Briefing | None = None, **config: float | str) -> DetectorAgent:
    agent = DETECTOR_AGENTS[PREFIX + name]({"weights": str(folder / f"{WEIGHTS[name]}.onnx"), **config})
    assert isinstance(agent, DetectorAgent)
    agent.start(about or briefing())
    return agent


def own_state(car: str) -> OwnState:
    return OwnState(*POSES[car], 0.0, 0.0, 0.0, 0.0, position_sigma=0.1)


SCANS = {
    car: scan(sensor(ROADS, profile="lmdrive"), HIDDEN, SEEN, own=(Kind.VEHICLE, *pose, 4.9, 2.1))
    for car, pose in POSES.items()
}
Change = Callable[[Sequence[Message]], Sequence[Message]]


def drive(agents: dict[str, DetectorAgent], ticks: int = 11, change: Change = lambda sent: sent) -> list[Reply]:
    """The replies of "a"; messages arrive a tick later, those of "b" changed."""
    replies: list[Reply] = []
    said: dict[str, Sequence[Message]] = {"a": (), "b": ()}
    for tick in range(ticks):
        now: dict[str, Sequence[Message]] = {}
        for car, agent in agents.items():
            heard = change(said["b"]) if car == "a" else said["a"]
            clouds = {} if tick % MAP_TICKS else {"top": SCANS[car]}
            reply = agent.act(Observation(tick, own_state(car), lidar=clouds, messages=tuple(heard)))
            check_reply(reply, frozenset(CONTROLLERS))
            now[car] = [replace(message, sender=car, tick=tick) for message in reply.messages]
            if car == "a":
                replies.append(reply)
        said = said | now
    return replies


def find_gap(reply: Reply, x: float, y: float) -> float:
    """The distance [m] of the nearest object to a place."""
    assert reply.detections is not None
    return float(np.hypot(*(reply.detections.boxes[:, :2] - (x, y)).T).min(initial=np.inf))


def test_the_wall_hides_the_car_from_the_own_lidar_alone() -> None:
    def count(car: str) -> int:
        x, y, yaw = POSES[car]
        points = SCANS[car].points
        places = points[:, :2] @ np.array(((math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw)))) + (x, y)
        near = np.abs(places - HIDDEN[1:3]) < (2.5, 1.2)
        return int((near.all(axis=1) & (points[:, 2] > -2.2)).sum())

    assert count("a") == 0 and count("b") > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", SHARING)
def test_a_hidden_car_is_known_if_another_shares_what_it_sees(weights: Path, name: str) -> None:
    told = drive({car: make_agent(weights, name) for car in POSES})
    assert find_gap(told[10], *HIDDEN[1:3]) < 3.0  # cells of 1.6 m with points, of which the sides have some
    mute = drive({car: make_agent(weights, name) for car in POSES}, change=lambda sent: ())
    assert find_gap(mute[10], *HIDDEN[1:3]) > 10.0


def test_a_detector_that_shares_nothing_says_nothing_and_does_not_listen(weights: Path) -> None:
    replies = drive({"a": make_agent(weights, "none"), "b": make_agent(weights, "fcooper")})
    assert all(reply.messages == () for reply in replies) and find_gap(replies[10], *HIDDEN[1:3]) > 10.0


def test_detections_come_once_a_scan_and_a_little_later(weights: Path) -> None:
    replies = drive({"a": make_agent(weights, "none")})
    looked = [tick for tick, reply in enumerate(replies) if reply.detections is not None]
    assert looked == [WAIT_TICKS + MAP_TICKS * i for i in range(3)]


@pytest.mark.parametrize("name", NAMES)
def test_labels_sensors_and_descriptions(weights: Path, name: str) -> None:
    agent = make_agent(weights, name)
    (lidar,) = agent.sensors()
    assert (lidar.kind, dict(lidar.options)) == ("lidar", {"profile": "lmdrive", "every_ticks": MAP_TICKS})
    assert derive_sensing_track([agent.sensors()]) == "sensor"
    assert agent.label == ("single" if name == "none" else "sharing")
    assert (type(agent).__doc__ or "").startswith("The paper's rule-based planner behind")


@pytest.mark.parametrize("name", SHARING)
def test_what_is_sent_and_when(weights: Path, name: str) -> None:
    replies = drive({"a": make_agent(weights, name)}, ticks=9)
    types = [[message.type for message in reply.messages] for reply in replies]
    told = [CAM, CPM] if name == "late" else [CAM]
    for tick, sent in enumerate(types):
        assert sent[: len(told)] == (told if tick % 2 == 0 else [])
        features = [one for one in sent if one == FEATURE]
        assert len(features) > 0 if name != "late" and tick % MAP_TICKS == 0 else features == []
    contents = [decode(message) for message in replies[4].messages]
    grids = {one.grid.name for one in contents if isinstance(one, Feature)}
    assert grids == (set() if name == "late" else {"points" if name == "early" else name})


def test_a_map_keeps_to_its_budget_and_cells_have_none(weights: Path) -> None:
    random = np.random.default_rng(1)
    dense = random.random((FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), np.float32)
    scan_of_all = EncodedScan(dense, random.random((FEATURE_CELLS, FEATURE_CELLS), np.float32))
    grid, pose = build_feature_grid(load_detector("attfuse", weights)), ReferencePose(0.0, 0.0, 0.0, 0)
    for budget in (1500, OPTIONS["budget"].default):
        sent = encode_features(scan_of_all, pose, grid, budget, 0.0)
        assert budget - MAX_PACKET_BYTES < sum(len(one.payload) for one in sent) <= budget
    reply = drive({"a": make_agent(weights, "early")}, 1)[0]
    assert sum(len(one.payload) for one in reply.messages) > OPTIONS["budget"].default


def test_tiles_without_a_road_user_are_not_sent(weights: Path) -> None:
    features = np.ones((FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), np.float32)
    confidence = np.full((FEATURE_CELLS, FEATURE_CELLS), LEAST_CONFIDENCE / 2, np.float32)
    confidence[20, 20] = 0.5
    grid, pose = build_feature_grid(load_detector("attfuse", weights)), ReferencePose(0.0, 0.0, 0.0, 0)
    (message,) = encode_features(EncodedScan(features, confidence), pose, grid, np.inf, LEAST_CONFIDENCE)
    content = decode(message)
    assert isinstance(content, Feature) and content.tiles.tolist() == [2 * 8 + 2]
    broken = EncodedScan(features * np.float32(np.nan), confidence)
    assert encode_features(broken, pose, grid, np.inf, LEAST_CONFIDENCE) == ()


def test_less_certain_boxes_are_no_objects(weights: Path) -> None:
    replies = drive({car: make_agent(weights, "fcooper", score=0.95) for car in POSES})
    assert replies[10].detections is not None and len(replies[10].detections.boxes) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cobevt", "early", "late"])
def test_an_agent_begins_anew_and_repeats_itself(weights: Path, name: str) -> None:
    agents = {car: make_agent(weights, name) for car in POSES}
    first = drive(agents)
    for agent in agents.values():
        agent.start(briefing())
    assert repr(drive(agents)) == repr(first)


def shout(sent: Sequence[Message]) -> list[Message]:
    """The same packets with the largest values there are, of either sign, in every channel of their cells."""
    loud: list[Message] = []
    for message in sent:
        content = decode(message)
        if isinstance(content, Feature):
            places = content.places[:200]  # more do not fit into a packet
            levels, steps = np.where(places % 2, 255, -255), np.full(content.grid.channels, 65504.0)
            noise = encode(replace(content, steps=steps, places=places, levels=levels))
            message = replace(noise, sender="b", tick=message.tick)
        loud.append(message)
    return loud


def garble(sent: Sequence[Message]) -> list[Message]:
    random = np.random.default_rng(5)
    return [replace(one, payload=random.bytes(len(one.payload))) for one in sent]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disconet", "early", "late"])
@pytest.mark.parametrize("change", [shout, garble])
def test_a_sender_of_noise_changes_what_is_known_and_breaks_nothing(weights: Path, name: str, change: Change) -> None:
    replies = drive({car: make_agent(weights, name) for car in POSES}, change=change)
    detections = replies[10].detections
    assert detections is not None and np.isfinite(detections.boxes).all()
    assert any(note.kind == "unreadable" for reply in replies for note in reply.notes) is (change is garble)


def test_numbers_that_no_trained_network_answers_make_no_boxes() -> None:
    scores = np.zeros((len(CLASSES), OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    numbers = np.zeros((BOX_NUMBERS, OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    scores[0, 10, 10], scores[0, 50, 50], scores[0, 90, 90] = 0.9, 0.8, np.nan
    numbers[2:4, 10, 10], numbers[:, 50, 50] = 1e9, np.nan
    found = decode_boxes(scores, numbers)
    assert found.scores == pytest.approx([0.9]) and np.isfinite(found.boxes).all() and found.boxes[0, 3] < 31.0


def find_boxes(*rows: tuple[float, ...]) -> DetectedBoxes:
    boxes: Float = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return DetectedBoxes(boxes, np.zeros(len(boxes), np.int64), np.ones(len(boxes)))


def test_tracks_learn_the_speed_of_what_moves_and_predict_it() -> None:
    tracker, speed = DetectionTracker(), 8.0
    assert len(tracker.predict(0)) == 0
    for tick in range(0, 21, MAP_TICKS):
        own = OwnState(0.0, 0.1 * tick, math.pi / 2, 2.0, 0.0, 0.0, 0.0)  # it looks along the world's y
        ahead = 20.0 + speed * tick * DT
        tracker.update(tick, own, find_boxes((ahead - own.y, -3.0, 0.0, 4.5, 2.0)))
    objects: Objects = tracker.predict(22)
    assert objects.speed == pytest.approx([speed], abs=0.8)
    assert (objects.x[0], objects.y[0]) == pytest.approx((3.0, 20.0 + speed * 22 * DT), abs=0.3)
    assert objects.yaw == pytest.approx([math.pi / 2]) and objects.kind.tolist() == [Kind.VEHICLE]


def test_what_is_seen_once_is_no_object_later_in_a_drive_and_what_lies_outside_the_grid_never() -> None:
    tracker, own = DetectionTracker(), OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    tracker.update(100, own, find_boxes((30.0, 0.0, 0.0, 4.5, 2.0), (1e6, 0.0, 0.0, 4.5, 2.0)))
    assert len(tracker.predict(102)) == 0
    for tick in range(104, 121, MAP_TICKS):
        tracker.update(tick, own, find_boxes((30.0, 0.0, 0.0, 4.5, 2.0), (1e6, 0.0, 0.0, 4.5, 2.0)))
    assert tracker.predict(122).x == pytest.approx([30.0], abs=0.1)


CONFIGS: list[tuple[str, Config, str]] = [
    ("attfuse", {"weights": "out"}, "expected the path of attfuse.onnx or attfuse.json, with attfuse-encoder.onnx"),
    ("late", {"weights": "late.onnx"}, "option weights: expected the path of none.onnx or none.json"),
    ("early", {"weights": 1.0}, "option weights: expected the path of early.onnx or early.json"),
    ("attfuse", {"weights": "nowhere/attfuse.onnx"}, "attfuse-encoder.json: cannot be read: No such file"),
    ("none", {"budget": 1000.0}, "expected options among (provider, score, weights), found 'budget'"),
    ("cobevt", {"budget": 10.0}, "option budget: expected a number in [200, 83880], found 10"),
    ("cobevt", {"score": 0.0}, "option score: expected a number in [0.1, 1], found 0"),
    ("fcooper", {"provider": "tpu"}, "option provider: expected one of auto, cpu, found 'tpu'"),
]


@pytest.mark.parametrize(("name", "config", "words"), CONFIGS)
def test_unusable_options_are_one_sentence(name: str, config: Config, words: str) -> None:
    with pytest.raises(InputError) as caught:
        DETECTOR_AGENTS[PREFIX + name](config)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_extra_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"agent perception-swap:late: expected ONNX Runtime .*pip install"):
        DETECTOR_AGENTS["perception-swap:late"]({})


def test_features_of_other_weights_are_not_used(tmp_path: Path, weights: Path) -> None:
    """The encoder of "b" has other bytes, and so another version: what its features mean is not known."""
    save_tiny_detector(tmp_path, "attfuse", encoder_seed=1)
    replies = drive({"a": make_agent(weights, "attfuse"), "b": make_agent(tmp_path, "attfuse")})
    notes = [note.text for reply in replies for note in reply.notes if note.kind == "unreadable"]
    assert len(notes) == 1
    assert re.match(r"feature from b: expected the grid attfuse version \d+, found attfuse version \d+", notes[0])
    assert find_gap(replies[10], *HIDDEN[1:3]) > 10.0


def test_all_fusions_have_an_agent() -> None:
    assert {*NAMES} == {*FUSIONS, "none", "late", "early"}

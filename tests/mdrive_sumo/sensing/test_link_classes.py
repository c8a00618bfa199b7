"""Classes of radio links by exact lines of sight, the twin of their text, and the scene of a tick."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import EgoState, Kind
from mdrive_sumo.roads.road_map import RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.sensing.link_classes import classify_links, list_blockers
from mdrive_sumo.sensing.radio_scene_builder import RadioSceneBuilder, choose_environment
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.street_corners import StreetCorners
from mdrive_sumo.v2x.radio.path_loss import LinkClass, RadioEnvironment, compute_corner_loss
from mdrive_sumo.v2x.radio.radio_settings import CornerModel, RadioProfile, RadioSettings

LOS, NLOSV, NLOSB = LinkClass.LOS, LinkClass.NLOSV, LinkClass.NLOSB
HOUSE = np.array([[10.0, -5.0, 20.0, -5.0], [20.0, -5.0, 20.0, 5.0], [20.0, 5.0, 10.0, 5.0], [10.0, 5.0, 10.0, -5.0]])
NO_HOUSE = np.zeros((0, 4)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
ONE_HOUSE = HOUSE, np.array([4]), np.array([[15.0, 0.0, math.hypot(5.0, 5.0)]])
CAR, TRUCK = [0.0, 0.0, 0.0, 4.9, 1.9, 1.5], [15.0, 0.0, 0.0, 12.0, 2.5, 3.4]


def place(box: list[float], x: float, y: float) -> list[float]:
    return [x, y, *box[2:]]


@pytest.mark.parametrize(
    ("others", "houses", "kind", "top"),
    [
        ([], NO_HOUSE, LOS, 0.0),
        ([TRUCK], NO_HOUSE, NLOSV, 3.4),
        ([place(CAR, 12.0, 0.5), TRUCK], NO_HOUSE, NLOSV, 3.4),
        ([place(CAR, 12.0, 0.5)], NO_HOUSE, NLOSV, 1.5),
        ([place(TRUCK, 15.0, 1.3)], NO_HOUSE, LOS, 0.0),  # 5 cm beside the line
        ([place(TRUCK, 15.0, 1.25)], NO_HOUSE, LOS, 0.0),  # its side is the line
        ([[15.0, 0.0, 0.0, 12.0, 2.5, 0.0]], NO_HOUSE, LOS, 0.0),  # hides nothing
        ([TRUCK], ONE_HOUSE, NLOSB, 0.0),
    ],
)
def test_what_lies_between_two_cars(
    others: list[list[float]], houses: tuple[Float, Int, Float], kind: LinkClass, top: float
) -> None:
    """Two cars 30 m apart, each with a box of its own, which blocks nothing."""
    boxes = np.array([place(CAR, 0.0, 0.0), place(CAR, 30.0, 0.0), *others])
    classes, tops = classify_links(boxes[:2, :2].copy(), np.array([0, 1]), 2, boxes, *houses)
    assert classes.tolist() == [[LOS, kind], [kind, LOS]]
    assert tops.tolist() == [[0.0, top], [top, 0.0]]


COORDINATE = st.floats(-40.0, 40.0)
BOX = st.tuples(
    COORDINATE,
    COORDINATE,
    st.floats(-4.0, 4.0),
    st.floats(0.2, 14.0),
    st.floats(0.2, 3.0),
    st.sampled_from([0.0, 1.5, 3.4]),
)


@given(st.lists(BOX, min_size=2, max_size=9), st.integers(0, 4), st.booleans(), COORDINATE)
def test_the_twin_classifies_alike(boxes: list[tuple[float, ...]], count: int, is_built: bool, x: float) -> None:
    rows = np.array(boxes)
    places = np.concatenate((rows[:, :2], [[x, 0.0]]))
    carriers = np.array([*range(len(rows)), -1])
    houses = ONE_HOUSE if is_built else NO_HOUSE
    compare_twins("sensing_link_classes_classify_links", places, carriers, min(count, len(places)), rows, *houses)


@pytest.mark.parametrize("wrong", [0, 1, 3, 4, 5])
def test_the_twin_refuses_arguments_that_do_not_fit(wrong: int) -> None:
    boxes = np.array([place(CAR, 0.0, 0.0), place(CAR, 30.0, 0.0)])
    arguments: list[object] = [boxes[:, :2].copy(), np.array([0, 1]), 2, boxes, *ONE_HOUSE]
    arguments[wrong] = np.zeros((2, 2, 2)) if wrong != 5 else np.array([9])
    with pytest.raises((ValueError, TypeError)):
        get_compiled("sensing_link_classes_classify_links")(*arguments)


@pytest.fixture(scope="module")
def crossing() -> RoadMap:
    return load_road_map(list_packaged_networks()["town_crossing"])


def make_frame(background: int = 0) -> SensingFrame:
    """Two CAVs, parked far apart, and background vehicles in a row."""
    egos = {"b": EgoState(0.0, 0.0, 0.0, 5.0), "a": EgoState(30.0, 0.0, 0.0, 5.0)}
    count = len(egos) + background
    names = (*egos, *(f"bg{i:03d}" for i in range(background)))
    x, zeros = np.array([0.0, 30.0, *(60.0 + 8.0 * i for i in range(background))]), np.zeros(count)
    kind = np.full(count, Kind.VEHICLE, dtype=np.uint8)
    return SensingFrame(0, Objects(names, kind, x, zeros, zeros, zeros + 5.0, zeros + 4.9, zeros + 1.9), egos)


def test_the_scene_has_stations_by_name_and_the_connected_share_of_the_background(crossing: RoadMap) -> None:
    frame, roadside = make_frame(400), {"rsu": (10.0, 20.0)}
    builder = RadioSceneBuilder(RadioSettings(RadioProfile.ITS_G5, connected_background=0.3), crossing, 1)
    scene = builder.build(frame, ["b", "a"], roadside, with_background=True)
    assert scene.stations == ("a", "b", "rsu")
    assert scene.xy[:3].tolist() == [[30.0, 0.0], [0.0, 0.0], [10.0, 20.0]]
    assert scene.height[:3].tolist() == [1.5, 1.5, 5.0]
    assert scene.classes.shape == scene.blocker.shape == (3, len(scene.xy))
    assert len(scene.xy) - 3 == pytest.approx(120, abs=35)
    assert scene.xy.tolist() == builder.build(frame, ["a", "b"], roadside, with_background=True).xy.tolist()
    assert len(builder.build(frame, ["a"], roadside, with_background=False).xy) == 2
    everybody = RadioSceneBuilder(RadioSettings(RadioProfile.ITS_G5, connected_background=1.0), crossing, 1)
    assert len(everybody.build(frame, ["a"], {}, with_background=True).xy) == 401  # a CAV that ended is no background


def test_props_and_people_block_as_they_hide() -> None:
    boxes = make_frame(4).boxes
    kind = np.array(
        [Kind.VEHICLE, Kind.VEHICLE, Kind.PEDESTRIAN, Kind.CYCLIST, Kind.STATIC, Kind.STATIC], dtype=np.uint8
    )
    length = np.array([4.9, 12.0, 0.5, 1.8, 6.0, 1.0])
    heights = list_blockers(replace(boxes, kind=kind, length=length, width=length / 3))[:, 5]
    assert heights.tolist() == [1.5, 3.4, 0.0, 0.0, 2.2, 0.0]


def test_a_map_is_a_highway_where_a_road_allows_70_km_h(crossing: RoadMap) -> None:
    assert choose_environment(crossing) is RadioEnvironment.URBAN
    assert choose_environment(load_road_map(list_packaged_networks()["motorway"])) is RadioEnvironment.HIGHWAY


def make_corner_houses() -> Any:
    """A crossing at (0, 0) of streets that are 20 m wide between four houses."""
    outline = np.array([[-8.0, -8.0], [8.0, -8.0], [8.0, 8.0], [-8.0, 8.0]])
    low, high = 10.0, 90.0
    houses = [
        SimpleNamespace(
            polygon=[(sx * low, sy * low), (sx * high, sy * low), (sx * high, sy * high), (sx * low, sy * high)]
        )
        for sx in (-1.0, 1.0)
        for sy in (-1.0, 1.0)
    ]
    return SimpleNamespace(junctions=[outline, outline + 500.0], buildings=houses)


def test_the_corner_model_takes_the_crossing_that_both_stations_see() -> None:
    """40 m before the crossing, 2 m off the middle, and 60 m into the other street: the mean of both directions."""
    houses = make_corner_houses()
    corners = StreetCorners(houses, BuildingEdges(houses))
    slant = math.hypot(40.0, 2.0)
    # Rays across a direction that is not quite the street's: the houses are a little farther than across the street.
    walls = 8.0 * slant / 40.0, 12.0 * slant / 40.0
    there = compute_corner_loss(slant, 60.0, 20.0, walls[0], height_m=1.5, suburban=False)
    back = compute_corner_loss(60.0, slant, sum(walls), 10.0, height_m=1.5, suburban=False)
    assert corners.compute_loss((40.0, 2.0), (0.0, 60.0), 1.5) == pytest.approx((there + back) / 2)
    assert corners.compute_loss((0.0, 60.0), (40.0, 2.0), 1.5) == corners.compute_loss((40.0, 2.0), (0.0, 60.0), 1.5)
    assert math.isnan(corners.compute_loss((40.0, 2.0), (50.0, 120.0), 1.5))


def test_the_scene_has_corner_losses_behind_buildings_only(crossing: RoadMap) -> None:
    builder = RadioSceneBuilder(
        RadioSettings(RadioProfile.ITS_G5, corner_model=CornerModel.VIRTUAL_SOURCE), crossing, 1
    )
    scene = builder.build(make_frame(), ["a", "b"], {}, with_background=False)
    assert scene.corner_db is not None
    assert (np.isnan(scene.corner_db) | (scene.classes == NLOSB)).all()

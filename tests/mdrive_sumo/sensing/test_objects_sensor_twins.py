"""The compiled detector against the Python text."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins
from testing.worlds import straight_road

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, DetectionProfile
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.sensing.detection_noise import FalsePositive, draw_false_positives
from mdrive_sumo.sensing.objects_sensor import Detector, detect
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, TrackNames
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

IDEAL_DETECTOR = Detector(PROFILES[IDEAL], True, math.pi, 0.0, 0.1, 0, 100.0, 1)
HERE = SensorPose(0.0, 0.0, 0.0, None)
PLACES = st.one_of(st.integers(-20, 20).map(float), st.floats(-80.0, 80.0))
SIZES = st.one_of(st.floats(0.3, 9.0), st.just(4.0))
ANGLES = st.one_of(st.floats(-9.0, 9.0), st.sampled_from((0.0, math.pi, -math.pi / 2)))
ROW = st.tuples(st.integers(0, 3), PLACES, PLACES, ANGLES, st.floats(-2.0, 20.0), SIZES, SIZES)
WALLS = BuildingEdges(
    replace(
        straight_road(),
        buildings=tuple(
            Building(id=f"h{x}", polygon=tuple((float(a), float(b)) for a, b in box_corners(x, y, 0.3, 14.0, 10.0)))
            for x, y in ((25.0, 12.0), (-30.0, -25.0))
        ),
    )
)


def objects(rows: list[tuple[float, ...]]) -> Objects:
    kind, *columns = np.array(rows, dtype=np.float64).reshape(-1, 7).T
    return Objects(tuple(f"vehicle ä{i}" for i in range(len(rows))), kind.astype(np.uint8), *columns)


def profiles() -> st.SearchStrategy[DetectionProfile]:
    share, some = st.floats(0.0, 1.0), st.floats(0.0, 3.0)
    flawed = st.builds(DetectionProfile, share, share, share, share, some, st.floats(1.0, 99.0), some, share, some,
                       st.floats(0.0, 40.0), st.integers(0, 3))  # fmt: skip
    return st.one_of(st.sampled_from([PROFILES[name] for name in PROFILES if name != IDEAL]), flawed)


@given(
    rows=st.lists(ROW, max_size=9),
    profile=profiles(),
    is_exact=st.booleans(),
    angles=st.tuples(st.sampled_from((math.pi, 1.0, 0.2)), ANGLES),
    min_visible=st.sampled_from((0.0, 0.1, 1.0)),
    sectors=st.sampled_from((0, 1, 8, 72)),
    eye=st.builds(SensorPose, PLACES, PLACES, ANGLES, st.sampled_from((None, 0)),
                  st.one_of(st.none(), st.builds(EgoState, PLACES, PLACES, ANGLES, st.just(3.0)))),
    tick=st.integers(0, 500),
)  # fmt: skip
def test_any_scene(
    rows: list[tuple[float, ...]], profile: DetectionProfile, is_exact: bool, angles: tuple[float, float],
    min_visible: float, sectors: int, eye: SensorPose, tick: int,
) -> None:  # fmt: skip
    detector = Detector(profile, is_exact, *angles, min_visible, sectors, 60.0, seed=tick * 7919)
    ghosts = draw_false_positives(profile, detector.seed, tick, (eye.x, eye.y), 60.0)
    view = SightView(eye, SensingFrame(tick, objects(rows), {}), WALLS, 60.0)
    told = compare_twins("sensing_objects_sensor_detect", detector, view, ghosts, TrackNames("me", 3))
    assert len(told.ids) <= len(rows) + len(ghosts)


BAD = st.sampled_from((math.nan, math.inf, -math.inf, 1e300, -0.0, 5.0))


@given(
    row=st.tuples(st.just(0.0), BAD, BAD, BAD, BAD, BAD, BAD),
    numbers=st.lists(BAD, min_size=7, max_size=7),
    half_fov=st.sampled_from((math.pi, 1.0, math.nan)),
)
def test_numbers_that_mean_nothing(row: tuple[float, ...], numbers: list[float], half_fov: float) -> None:
    eye = SensorPose(numbers[0], 0.0, numbers[1], None, EgoState(numbers[2], 1.0, numbers[3], 0.0))
    ghosts = [FalsePositive(0, 0, 0, "ghost", numbers[4], numbers[5], numbers[6])]
    scene = SensingFrame(5, objects([row, (0.0, 9.0, 4.0, 0.0, 1.0, 4.0, 2.0)]), {})
    for profile in (PROFILES["cobevt"], replace(PROFILES["cobevt"], size_sigma=1e6)):
        detector = Detector(profile, False, half_fov, 0.0, 0.1, 8, 60.0, 1)
        arguments = detector, SightView(eye, scene, WALLS, 60.0), ghosts
        compare_twins("sensing_objects_sensor_detect", *arguments, TrackNames("me", 3))


def test_equal_distances_keep_the_order_of_the_scene() -> None:
    scene = objects([(0, x, y, 0.0, 0.0, 1.0, 1.0) for x, y in ((9.0, 0.0), (0.0, 5.0), (-9.0, 0.0), (0.0, -5.0))])
    names = TrackNames("me", 3)
    view = SightView(HERE, SensingFrame(0, scene, {}), WALLS, 60.0)
    told = compare_twins("sensing_objects_sensor_detect", IDEAL_DETECTOR, view, [], names)
    assert told.ids == tuple(names[scene.ids[row]] for row in (1, 3, 0, 2))


def test_what_is_not_a_scene_is_refused() -> None:
    view = SightView(HERE, SensingFrame(0, replace(objects([]), x=np.zeros(2)), {}), WALLS, 60.0)
    with pytest.raises(ValueError, match="expected columns with 0 rows, one for each id, found 2"):
        detect(IDEAL_DETECTOR, view, [], TrackNames("me", 3))
    with pytest.raises(AttributeError, match="tick"):
        detect(IDEAL_DETECTOR, replace(view, scene=None), [], TrackNames("me", 3))  # pyright: ignore[reportArgumentType]

"""Families of riders: every CAV crosses a stream that passes closely behind what stands at the kerb."""

import random
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard import families_agreed
from mdrive_sumo.generate.hard.families_riders import FAMILIES
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.riders import (
    DELIVERING,
    PARKED,
    ROW_GAP_M,
    ROW_M,
    RiderKind,
    draw_row,
)
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.sensing.lidar_world import CAR_M, assume_vehicle_height
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES

TRIES = 8
LEAST_M = 1.0
"""[m] Between the middles of riders of two streams at a corner: they are 0.6 m wide and pass at right angles."""


def build_one(family: ScenarioFamily, folder: Path) -> tuple[dict[str, float], Scenario]:
    place = draw_hard_place(PlaceTask(family.places[0], "families/0", folder))
    assert place is not None
    roads, rng = place.load_roads(), random.Random(family.category)
    for number in range(TRIES):
        values = tuple(rng.uniform(one.low, one.high) for one in family.parameters)
        try:
            made = family.build(FamilyCandidate(f"one_{number}", place.name, values, "seed"), roads)
        except (ProposalRejected, InputError):
            continue
        return dict(zip((one.name for one in family.parameters), values, strict=True)), made
    raise AssertionError(f"{family.category}: expected a sound candidate on {place.name}, found none")


def build_course(rider: Actor) -> shapely.LineString:
    assert isinstance(rider.motion, ReplayMotion)
    return shapely.LineString([pose[1:3] for pose in rider.motion.poses])


def find_places(rider: Actor, times: Float) -> Float:
    """Return where a rider is at times (T,) [s]: (T, 2) [m], NaN while it is not there."""
    assert isinstance(rider.motion, ReplayMotion)
    poses = np.array([pose[:3] for pose in rider.motion.poses])
    columns = [np.interp(times, poses[:, 0], poses[:, k], np.nan, np.nan) for k in (1, 2)]
    return np.column_stack(columns)


@pytest.mark.parametrize("family", (*FAMILIES, *families_agreed.FAMILIES), ids=lambda family: family.category)
def test_every_cav_crosses_riders_who_pass_closely_behind_a_row(
    family: ScenarioFamily, tmp_path_factory: pytest.TempPathFactory
) -> None:
    values, scenario = build_one(family, tmp_path_factory.getbasetemp() / "hard-places")
    riders = [one for one in scenario.actors if one.kind == "cyclist"]
    parked = [build_user_box(one) for one in scenario.actors if one.kind == "vehicle"]
    courses = [build_course(one) for one in riders]
    assert not any(one.avoid_collision for one in riders)
    for ego in scenario.egos:
        route = shapely.LineString([point[:2] for point in ego.route])
        assert any(route.crosses(course) for course in courses)
        assert min(box.distance(route) for box in parked) >= values["side_m"] - 0.2
    gaps = [min(box.distance(course) for box in parked) - riders[0].width / 2 for course in courses]
    assert min(gaps) == pytest.approx(values["free_m"], abs=0.16)
    assert max(gaps) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("family", families_agreed.FAMILIES, ids=lambda family: family.category)
def test_cavs_come_from_all_streets_and_riders_of_two_streams_never_touch(
    family: ScenarioFamily, tmp_path_factory: pytest.TempPathFactory
) -> None:
    values, scenario = build_one(family, tmp_path_factory.getbasetemp() / "hard-places")
    ends = [ego.lanes[-1] for ego in scenario.egos]
    assert len(set(ends)) == families_agreed.ARMS
    assert max(map(ends.count, ends)) == max(round(values["own"]), round(values["across"]))
    assert len(scenario.rsus) == families_agreed.ARMS
    times = np.arange(0.0, 60.0, 0.05)
    streams: dict[str, list[Float]] = {}
    for rider in scenario.actors:
        if rider.kind == "cyclist":
            streams.setdefault(rider.id.split("_")[0], []).append(find_places(rider, times))
    assert len(streams) == families_agreed.ARMS
    met = 0
    for some, others in combinations(streams.values(), 2):
        away = [np.hypot(*(one - other).T) for one in some for other in others]
        least = min((float(np.nanmin(one)) for one in away if not np.isnan(one).all()), default=np.inf)
        met += least < 10.0
        assert least > LEAST_M
    assert met == families_agreed.ARMS, "each stream passes through two others, at corners"


def test_place_without_four_streets_is_refused_with_its_name(tmp_path: Path) -> None:
    choice = PlaceChoice("crossing", {"arms": 3, "control": "priority", "area": "town"})
    place = draw_hard_place(PlaceTask(choice, "riders/0", tmp_path))
    assert place is not None
    family = families_agreed.FAMILIES[0]
    values = tuple(one.low for one in family.parameters)
    with pytest.raises(ProposalRejected, match=f"{place.name}: expected a crossing of four streets of one lane"):
        family.build(FamilyCandidate("one", place.name, values, "seed"), place.load_roads())


def test_rows_differ_and_begin_with_what_hides_riders() -> None:
    kind = RiderKind("bicycle", DELIVERING, PARKED, ("yield",))
    rows = [draw_row(kind, random.Random(f"seed{k}")) for k in range(60)]
    assert len(set(rows)) > 40
    firsts = Counter(row[0] for row in rows)
    assert set(firsts) == set(DELIVERING)
    assert max(firsts, key=lambda one: firsts[one]) == "truck"
    for row in rows:
        assert assume_vehicle_height(BODY_SIZES[row[0]][0]) > CAR_M
        assert ROW_M <= sum(BODY_SIZES[model][0] + ROW_GAP_M for model in row) < ROW_M + 17.0
    assert draw_row(kind, random.Random("seed7")) == rows[7]

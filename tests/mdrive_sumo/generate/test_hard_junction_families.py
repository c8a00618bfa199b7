"""Families at junctions of drawn places build sound, equal scenarios; their sites agree with a second method."""

import random
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard import families_rows
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.junction_parameters import OLD_TOWNS
from mdrive_sumo.generate.hard.sites.crossroads import find_crossroads
from mdrive_sumo.generate.hard.sites.junction_conflicts import find_junction_conflicts
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, compute_timing, find_junction_ways
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion
from mdrive_sumo.worlds.placement.lane_chains import MEETING_M, build_route_line
from mdrive_sumo.worlds.places import draw_place, write_place

FAMILIES = families_rows.FAMILIES
CATEGORIES = [family.category for family in FAMILIES]
DRAWS = 12
"""Candidates of which at least one is sound: most are, but for those that have no room."""


@pytest.fixture(scope="module")
def place_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("places")


def draw_roads(choice: PlaceChoice, folder: Path) -> RoadMap:
    place = draw_place(choice.kind, "junctions", **choice.parameters)
    path = folder / place.name
    return load_road_map(path if path.exists() else write_place(place, path))


def draw_values(family: ScenarioFamily, number: int) -> tuple[float, ...]:
    rng = random.Random(f"{family.category}/{number}")
    return tuple(rng.uniform(one.low, one.high) for one in family.parameters)


def build_first(family: ScenarioFamily, roads: RoadMap) -> tuple[FamilyCandidate, Scenario] | None:
    for number in range(DRAWS):
        candidate = FamilyCandidate(f"c{number}", roads.name, draw_values(family, number), f"s{number}")
        try:
            return candidate, family.build(candidate, roads)
        except (ProposalRejected, InputError):
            continue
    return None


def check_no_cav_ahead(actor: Actor, scenario: Scenario, roads: RoadMap) -> None:
    """A hidden vehicle that drives from the start on has no CAV before it on its lanes: the witness is behind."""
    assert isinstance(actor.motion, LaneMotion)
    first = roads.lanes[actor.motion.lanes[0]].centre
    start_m = first.project(actor.start.x, actor.start.y)[0]
    for ego in scenario.egos:
        if ego.lanes[0] == actor.motion.lanes[0]:
            assert first.project(ego.start.x, ego.start.y)[0] < start_m


@pytest.mark.parametrize("family", FAMILIES, ids=CATEGORIES)
def test_family_builds_equal_scenarios_with_a_witness(family: ScenarioFamily, place_folder: Path) -> None:
    for choice in family.places:
        roads = draw_roads(choice, place_folder)
        if (built := build_first(family, roads)) is not None:
            break
    else:
        pytest.fail(f"{family.category}: no place has a sound candidate")
    candidate, scenario = built
    assert family.build(candidate, roads) == scenario
    assert 2 <= len(scenario.egos) <= 12
    assert all(
        ego.start_speed <= max(roads.lanes[lane].speed_limit for lane in ego.lanes) + 0.1 for ego in scenario.egos
    )
    entered = {lane for ego in scenario.egos for lane in ego.lanes if lane in roads.junction_controls}
    assert entered, "no route meets a controlled junction"
    starts = {roads.lanes[ego.lanes[0]].edge for ego in scenario.egos}
    assert len(starts) > 1 or scenario.rsus, "nobody sees from elsewhere"
    for actor in scenario.actors:
        if isinstance(actor.motion, LaneMotion) and actor.trigger is None:
            check_no_cav_ahead(actor, scenario, roads)
    other_seed = FamilyCandidate(candidate.scenario_id, candidate.place, candidate.values, f"{candidate.seed}x")
    assert family.build(other_seed, roads).egos == scenario.egos  # CAVs follow from the values alone


@pytest.mark.parametrize("family", FAMILIES, ids=CATEGORIES)
def test_family_refuses_values_out_of_bounds(family: ScenarioFamily, place_folder: Path) -> None:
    roads = draw_roads(family.places[0], place_folder)
    values = [one.high for one in family.parameters]
    values[0] = family.parameters[0].high + 1.0
    with pytest.raises(InputError, match=f"{family.category}: {family.parameters[0].name}: expected"):
        family.build(FamilyCandidate("c", roads.name, tuple(values), "s"), roads)


def test_place_without_junction_is_refused_with_its_name(place_folder: Path) -> None:
    roads = draw_roads(PlaceChoice("corridor", {"junctions": 0, "lanes": 1, "signals": "none"}), place_folder)
    family = FAMILIES[0]
    with pytest.raises(ProposalRejected) as rejected:
        family.build(FamilyCandidate("c", roads.name, draw_values(family, 0), "s"), roads)
    assert roads.name in rejected.value.reason
    assert "found none" in rejected.value.reason


@pytest.fixture(scope="module", params=[0, 1, 2], ids=[one.kind for one in OLD_TOWNS])
def town(request: pytest.FixtureRequest, place_folder: Path) -> RoadMap:
    return draw_roads(OLD_TOWNS[request.param], place_folder)


def test_ways_are_the_connections_of_the_net_and_begin_junctions_at_their_stop_line(town: RoadMap) -> None:
    ways = find_junction_ways(town)
    found = {(way.approach, way.inside) for way in ways}
    linked = {(a.id, b) for a in town.driving if not a.junction for b in a.successors if town.lanes[b].junction}
    assert found <= linked
    assert len(found) >= 0.7 * len(linked)  # the others turn back
    for way in ways:
        line = build_route_line(town, way.lanes).curve
        assert line.at(way.stop_m) == pytest.approx(tuple(town.lanes[way.inside].centre.xy[0]), abs=0.6)
        assert all(there in town.lanes[here].successors for here, there in pairwise(way.lanes))


def test_conflicts_are_the_pairs_whose_lanes_inside_come_near(town: RoadMap) -> None:
    ways = find_junction_ways(town)
    met = {(one.own, one.other) for one in find_junction_conflicts(town)}
    lines: dict[JunctionWay, shapely.LineString] = {}
    for way in ways:
        line = build_route_line(town, way.lanes).xy
        lines[way] = shapely.LineString(line[int(way.stop_m) : int(way.exit_m) + 2])
    for own in ways:
        for other in ways:
            if own.junction != other.junction or town.lanes[own.approach].edge == town.lanes[other.approach].edge:
                continue
            gap_m = lines[own].distance(lines[other])
            if gap_m < MEETING_M - 0.6:
                assert (own, other) in met
            if gap_m > MEETING_M:
                assert (own, other) not in met


def test_who_gives_way_meets_who_has_priority(town: RoadMap) -> None:
    for site in find_crossroads(town, ("yield",)):
        for one in site.others:
            assert one.own.control == "yield"
            assert one.other.control == "priority-road"
        if site.far is not None:
            assert site.far.from_left != site.meeting.from_left


def test_timing_keeps_limits_and_slows_down_in_bends(town: RoadMap) -> None:
    for way in find_junction_ways(town)[:8]:
        timing = compute_timing(town, way.lanes)
        assert timing.speed.max() <= max(town.lanes[lane].speed_limit for lane in way.lanes) + 1e-9
        assert np.all(np.diff(timing.time) > 0.0)
        if way.turn != "straight":
            assert timing.speed[int(way.stop_m) : int(way.exit_m)].min() < 9.0

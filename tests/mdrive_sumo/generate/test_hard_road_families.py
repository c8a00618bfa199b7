"""Families of the hard tier on fast and narrow roads: their traffic, platoons and single-lane places."""

import random
from collections.abc import Sequence

import pytest
import shapely

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.core.state import Actors
from mdrive_sumo.generate.hard import (
    hidden_stop,
    motorway_ramps,
    narrow_street,
    priority_crossings,
    works_zone,
)
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily, load_network
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.scenario.background import Background, BackgroundVehicle, CarFollowing
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.worlds.placement.cavs import NoRoomError

FAMILIES: Sequence[ScenarioFamily] = (
    priority_crossings.AMBULANCE_FAMILIES[0],
    hidden_stop.FAMILY,
    priority_crossings.MIXED_FAMILIES[0],
    motorway_ramps.MERGE_FAMILY,
    motorway_ramps.WEAVE_FAMILY,
    narrow_street.FAMILY,
    priority_crossings.PLATOON_FAMILIES[0],
    works_zone.FAMILY,
)


def build(family: ScenarioFamily, number: int, **fixed: float) -> Scenario | None:
    """Return the scenario of a seeded random point, with the given values; None if it is rejected."""
    rng = random.Random(f"{family.category}/{number}")
    values = [fixed.get(one.name, rng.uniform(one.low, one.high)) for one in family.parameters]
    try:
        return family.build(FamilyCandidate("x", tuple(values), f"s{number}"))
    except (ProposalRejected, NoRoomError):
        return None


WITNESSES = {"emergency-vehicle": "witnesses", "mixed-crossing": "eastward"}
"""Without a CAV that sees what is hidden there is always a roadside unit."""


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.category)
def test_every_parameter_changes_the_scenario(family: ScenarioFamily) -> None:
    fixed = {one.name: (one.low + one.high) / 2 for one in family.parameters}
    if witness := WITNESSES.get(family.category):
        fixed[witness] = 1.0
    middle = build(family, 0, **fixed)
    assert middle is not None
    for one in family.parameters:
        ends = [build(family, 0, **{**fixed, one.name: end}) for end in (one.low, one.high)]
        assert any(end is not None and end != middle for end in ends), one.name


def test_no_vehicle_of_a_flow_starts_right_before_or_behind_a_cav() -> None:
    scenario = build(motorway_ramps.MERGE_FAMILY, 1, right_flow=1200.0, left_flow=1500.0)
    assert scenario is not None
    roads = load_network(scenario.network)
    vehicles = [one for one in scenario.background.vehicles if one.depart_s == 0.0]
    assert vehicles
    for vehicle in vehicles:
        lane = roads.lanes[f"{vehicle.edges[0]}_{vehicle.depart_lane}"]
        rear = shapely.Point(lane.centre.at(vehicle.depart_pos_m - vehicle.length))
        front = shapely.Point(lane.centre.at(vehicle.depart_pos_m))
        for ego in scenario.egos:
            box = shapely.Polygon(
                box_corners(ego.start.x, ego.start.y, ego.start.yaw, 4.9 + 2.0 * ego.start_speed, 2.0)
            )
            assert not box.contains(rear) and not box.contains(front), (vehicle.id, ego.id)


def test_a_truck_keeps_its_governed_speed_and_fast_departures_are_on_time() -> None:
    scenario = build(motorway_ramps.MERGE_FAMILY, 0)
    assert scenario is not None
    way = {"edges": ("main", "merge", "after"), "depart_s": 0.0, "depart_pos_m": 60.0}
    truck = BackgroundVehicle(id="truck", depart_lane=0, depart_speed=20.0, driving=CarFollowing(max_speed=22.0), **way)
    car = BackgroundVehicle(id="car", depart_lane=1, depart_speed=26.6, **way)
    empty = scenario.model_copy(update={"background": Background(vehicles=(truck, car))})
    with SumoWorld(empty, load_network(scenario.network), {}, 1) as world:
        actors = world.start({}, Actors.empty()).actors
        assert set(actors.ids) == {"truck", "car"}
        for _ in range(200):
            actors = world.advance({}, Actors.empty(), ()).actors
    speed = dict(zip(actors.ids, actors.speed.tolist(), strict=True))
    assert speed["truck"] <= 22.0 + 1e-6 < 25.0 < speed["car"]


@pytest.mark.parametrize(
    ("network", "ways"),
    [
        (works_zone.NETWORK, (("zone_eastward_0", "zone_westward_0"),)),
        (narrow_street.NETWORK, (("west_eastward_0", "west_westward_0"), ("east_eastward_0", "east_westward_0"))),
    ],
)
def test_two_cars_cannot_pass_each_other_in_a_single_lane_place(network: str, ways: Sequence[tuple[str, str]]) -> None:
    roads = load_network(network)
    for one, other in ways:
        lines = [shapely.LineString(roads.lanes[name].centre.xy) for name in (one, other)]
        stations = range(0, int(lines[0].length), 2)
        gaps = [lines[0].interpolate(s).distance(lines[1]) for s in stations]
        assert max(gaps) > 3.4  # they can pass elsewhere
        assert 45.0 < 2 * sum(gap < 2.0 for gap in gaps) < 110.0

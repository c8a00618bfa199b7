"""SUMO's vehicles of the v2xpnp suite never jump sideways, neither where they depart nor where their schedule ends."""

import math

import pytest

from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scenario.variation import vary_scenario
from mdrive_sumo.sumo import SumoWorld

pytestmark = pytest.mark.slow

JUMP_M = 0.25
"""Sideways displacement [m] in a tick, i.e. 5 m/s, that no car does."""
TICKS = 230
"""9 s of log, and what follows."""
DEPARTS_IN_A_BEND = ("corridor_059", "crossing_029")
LOG_ENDS_IN_A_LANE_CHANGE = ("corridor_014", "corridor_017")


def find_jumps(scenario: Scenario, roads: RoadMap, ticks: int) -> list[tuple[str, int, float]]:
    """Return vehicle, tick and sideways displacement [m] of all jumps, in SUMO's traffic alone."""
    found: list[tuple[str, int, float]] = []
    last: dict[str, tuple[float, float, float]] = {}
    with SumoWorld(scenario, roads, {}, derive_seed(0, scenario.id, "sumo")) as world:
        for tick in range(ticks):
            seen = (world.advance({}, Actors.empty(), ()) if tick else world.start({}, Actors.empty())).actors
            poses = dict(
                zip(seen.ids, zip(seen.x.tolist(), seen.y.tolist(), seen.yaw.tolist(), strict=True), strict=True)
            )
            for name in poses.keys() & last.keys():
                (x, y, yaw), (x0, y0, yaw0) = poses[name], last[name]
                heading = yaw0 + wrap_angle(yaw - yaw0) / 2
                sideways = math.cos(heading) * (y - y0) - math.sin(heading) * (x - x0)
                if abs(sideways) > JUMP_M:
                    found.append((name, tick, round(sideways, 2)))
            last = poses
    return found


@pytest.mark.parametrize("name", [*DEPARTS_IN_A_BEND, *LOG_ENDS_IN_A_LANE_CHANGE])
def test_no_vehicle_jumps_sideways(name: str) -> None:
    assert find_jumps(*find_scenario(name)[:2], TICKS) == []


def test_nor_in_the_world_of_another_seed() -> None:
    written, roads, _ = find_scenario("corridor_059")
    assert find_jumps(vary_scenario(written, roads, 1), roads, TICKS) == []


@pytest.mark.full
def test_no_vehicle_of_the_suite_jumps_sideways() -> None:
    for scenario in load_suite("v2xpnp@0"):
        assert find_jumps(*find_scenario(scenario.id, "v2xpnp")[:2], TICKS) == [], scenario.id

"""A suite of bucket `Hard` on packaged networks: CAVs that start at road speed. No tests in here."""

from pathlib import Path

from mdrive_sumo.roads import build_lane_route, find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite


def build_ego(network: str, name: str, lane: str, stations: tuple[float, float], speed: float) -> Ego:
    """A CAV that drives along one lane, between two stations [m], and starts at speed [m/s]."""
    route = build_lane_route(load_road_map(find_network_folder(network)), (lane,), *stations)
    points = tuple((float(x), float(y), float(yaw)) for (x, y), yaw in zip(route.xy, route.yaw, strict=True))
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), start_speed=speed, lanes=(lane,), route=points)


def build_fast_scenario(network: str = "expressway", lane: str = "before_1", speed: float = 20.0) -> Scenario:
    """Two CAVs in one lane, 0.4 of its length apart, at road speed."""
    length = load_road_map(find_network_folder(network)).lanes[lane].centre.length
    egos = (
        build_ego(network, "0", lane, (10.0 + 0.4 * length, length - 5.0), speed),
        build_ego(network, "1", lane, (10.0, 0.75 * length), speed),
    )
    return Scenario(id=f"fast_{network}", bucket="Hard", category="fast", network=network, speeds="road", egos=egos)


def make_hard_suite(folder: Path, *scenarios: Scenario) -> Path:
    """Save the scenarios (by default one) as a suite; returns its folder."""
    save_suite(Suite(SuiteFile(name="fast", title="Fast"), folder, scenarios or (build_fast_scenario(),)))
    return folder

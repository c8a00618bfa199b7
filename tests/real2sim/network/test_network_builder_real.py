"""The maps of the real logs as networks, and every vehicle of theirs on them."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import all_links, lane, plant
from testing.real_logs import READ
from testing.sampling import sampled

from mdrive_sumo.core.geometry import Float, build_polyline
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, load_road_map
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.match.lane_matcher import STILL_M, match_track
from real2sim.network import NetworkReport, build_network
from real2sim.network.lane_directions import reverse_lane, vote_directions
from real2sim.network.lane_links import rebuild_links
from real2sim.network.lane_segment import LaneSegment, clip_polyline
from real2sim.recording import Recording

pytestmark = pytest.mark.slow

SAMPLE = ("us101", "interaction")
LEFT_HAND = ("scene-1100",)


@dataclass(frozen=True)
class Log:
    recording: Recording
    motions: tuple[Float, ...]

    @property
    def map(self) -> HdMap:
        return self.recording.map


@cache
def read(name: str) -> Log:
    recording = READ[name]()
    vehicles = [track for view in recording.views for track in view.tracks if track.category.kind is Kind.VEHICLE]
    return Log(recording, tuple(np.column_stack((track.x, track.y, track.yaw)) for track in vehicles))


def built(name: str, hd_map: HdMap, folder: Path) -> tuple[NetworkReport, RoadMap]:
    log = read(name)
    report = build_network(hd_map, log.motions, folder, name, log.recording.dt_s)
    return report, load_road_map(folder)


@dataclass(frozen=True)
class Network:
    name: str
    report: NetworkReport
    roads: RoadMap


@pytest.fixture(scope="module", params=sampled(READ, SAMPLE))
def network(request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Network:
    return Network(request.param, *built(request.param, read(request.param).map, tmp_path_factory.mktemp("net")))


def test_centre_lines_lie_on_those_of_the_source(network: Network) -> None:
    report = network.report
    assert max(report.deviation.mean, report.deviation.back_mean) <= 0.01  # the issue asks for 0.2 m
    assert max(report.deviation.p95, report.deviation.back_p95) <= 0.02  # the issue asks for 0.5 m
    assert report.left_hand is (network.name in LEFT_HAND)
    assert len(report.drop_reason_by_lane) <= 1
    assert report.directions.inverted == ()
    assert report.links_dropped == ()


def test_every_driven_manoeuvre_is_routable(network: Network) -> None:
    driving = [motion for motion in read(network.name).motions if moves(motion)]
    matches = [match_track(motion, network.roads) for motion in driving]
    on_road = [found for found in matches if not found.is_off_road]
    assert all(found.reason == "" for found in on_road)
    assert all(found.route for found in on_road)
    for motion, found in zip(driving, matches, strict=True):
        if found.is_off_road:  # the source's own lanes are as far away
            assert near_lanes(network.name, seen(motion)) < 0.51
    assert len(on_road) >= 0.6 * len(driving)


@pytest.mark.full
@pytest.mark.parametrize("name", READ)
def test_maps_as_dirty_as_those_of_v2xpnp_route_every_manoeuvre_too(
    name: str, shared_data: Path, tmp_path: Path
) -> None:
    """No directions, no sides, no neighbours, a fifth of the links, ends up to 0.7 m short, lanes 5 cm astray."""
    _, roads = built(name, dirty(read(name).map, np.random.default_rng(0)), tmp_path)
    matches = [match_track(motion, roads) for motion in read(name).motions if moves(motion)]
    assert {found.reason for found in matches if not found.is_off_road} == {""}
    assert sum(not found.is_off_road for found in matches) >= 0.6 * len(matches)


def dirty(hd_map: HdMap, rng: np.random.Generator) -> HdMap:
    lanes: dict[str, MapLane] = {}
    for id_, one in hd_map.lanes.items():
        if one.kind is LaneKind.DRIVING and long_enough(one.centre):
            line = build_polyline(one.centre)
            ends = rng.uniform(0.0, min(0.7, line.length / 5), 2)
            xy = clip_polyline(line, ends[0], line.length - ends[1]).xy + rng.normal(0.0, 0.05, (1, 2))
            exits = tuple(exit_ for exit_ in one.exits if rng.random() < 0.2)
            lanes[id_] = lane(id_, xy[::-1] if rng.random() < 0.3 else xy, exits, directed=False)
    return HdMap(lanes=lanes)


def seen(motion: Float) -> Float:
    return motion[np.isfinite(motion[:, 0]), :2]


def moves(motion: Float) -> bool:
    """Travels over 4 m; what stands jitters by less."""
    return bool(np.ptp(seen(motion), axis=0).max() >= 2 * STILL_M)


def near_lanes(name: str, xy: Float) -> float:
    """Share of points within 4 m of a point of some lane of the source."""
    vertices = np.concatenate([lane.centre for lane in read(name).map.lanes.values() if lane.kind == "driving"])
    return float(np.mean([np.hypot(*(vertices - point).T).min() < 4.0 for point in xy]))


@pytest.mark.parametrize(
    ("share", "names"),
    [
        pytest.param(0.3, (*SAMPLE, "peach"), id="sample"),
        pytest.param(0.1, READ, id="few", marks=pytest.mark.full),
        pytest.param(0.3, READ, id="many", marks=pytest.mark.full),
    ],
)
def test_faults_planted_in_real_maps_are_repaired(share: float, names: Collection[str], shared_data: Path) -> None:
    """98 % of reversed lanes and of removed links; lanes of which nothing is known are told apart as undecided."""
    rng = np.random.default_rng(0)
    planted = repaired = wrong = 0
    for name in names:
        lanes = {id_: one for id_, one in read(name).map.lanes.items() if long_enough(one.centre)}
        clean = HdMap(lanes={id_: replace(lane, directed=False) for id_, lane in lanes.items()})
        faulty = plant(clean, rng, share, share)
        found = vote_directions(faulty.map.lanes, read(name).motions)
        inverted = set(found.inverted)
        straight = {id_: reverse_lane(lane) if id_ in inverted else lane for id_, lane in faulty.map.lanes.items()}
        added = set(rebuild_links(strips(HdMap(lanes=straight)), all_links(straight)).added)
        told = faulty.reversed - set(found.undecided)
        planted += len(told) + len(faulty.removed)
        repaired += len(inverted & told) + len(added & faulty.removed)
        wrong += len(inverted - faulty.reversed)
        assert len(found.undecided) <= 0.03 * len(lanes)
    assert planted > 24 * len(names)
    assert repaired >= 0.98 * planted
    assert wrong <= 0.01 * planted


def long_enough(centre: Float) -> bool:
    return len(centre) > 1 and float(np.hypot(*np.diff(centre, axis=0).T).sum()) > 0.5


def strips(hd_map: HdMap) -> dict[str, LaneSegment]:
    return {
        id_: LaneSegment(id_, id_, build_polyline(lane.centre), 3.5, 13.9, lane.kind, lane.junction)
        for id_, lane in hd_map.lanes.items()
    }

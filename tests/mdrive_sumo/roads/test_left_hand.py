"""Networks and logs of places that keep to the left."""

import gzip
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.busy_log import Crowd, busy_truth
from testing.real_logs import READ

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.netconvert import find_netconvert
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum
from real2sim.hd_map import HdMap, MapLane
from real2sim.match import match_track
from real2sim.network import NetworkReport, build_network
from real2sim.pipeline.conversion_options import ConversionOptions
from real2sim.pipeline.quality_file import QualityFile, build_quality_file
from real2sim.pipeline.scenario_builder import build_scenario
from real2sim.recording import RecordedTrack, Recording
from real2sim.source_scene import SourceScene

pytestmark = pytest.mark.slow

NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>'
EDGES = '<edges><edge id="ab" from="a" to="b" numLanes="3"/><edge id="ba" from="b" to="a" numLanes="2"/></edges>'


@pytest.fixture(scope="session")
def netconvert() -> Path:
    try:
        return find_netconvert()
    except InputError:
        pytest.skip("needs netconvert")


def compiled(netconvert: Path, folder: Path, *options: str) -> RoadMap:
    """A road of three lanes eastward and two westward."""
    (folder / "n.nod.xml").write_text(NODES)
    (folder / "e.edg.xml").write_text(EDGES)
    call = (str(netconvert), "-n", "n.nod.xml", "-e", "e.edg.xml", *options, "-o", "net.xml")
    subprocess.run(call, cwd=folder, check=True, capture_output=True)
    xml = (folder / "net.xml").read_bytes()
    (folder / NET_FILE).write_bytes(gzip.compress(xml))
    about = NetworkFile(
        name="road", origin="test", licence="none", offset=(0.0, 0.0), build=(), checksum=compute_net_checksum(xml)
    )
    (folder / NETWORK_FILE).write_text(about.model_dump_json())
    return load_road_map(folder)


@pytest.mark.parametrize("options", [(), ("--lefthand", "true"), ("--lefthand", "false")])
def test_the_left_neighbour_lies_to_the_left(netconvert: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    roads = compiled(netconvert, tmp_path, *options)
    left_hand = options[1:] == ("true",)
    assert bool(roads.lanes["ab_0"].centre.xy[0, 1] > 0) is left_hand  # index 0 is at the kerb
    beside = [(lane.id, lane.left, lane.right) for lane in roads.driving if not lane.junction]
    assert sum(bool(left) + bool(right) for _, left, right in beside) == 6
    for name, left, right in beside:
        for other, side in ((left, 1), (right, -1)):
            if other:
                aside = roads.lanes[name].centre.project(*roads.lanes[other].centre.at(50.0))[1]
                assert aside * side == pytest.approx(3.2, abs=0.01)


# --- logs, mirrored at the x axis


def mirrored_points(points: Float) -> Float:
    return points * (1.0, -1.0)


def mirrored_lane(lane: MapLane) -> MapLane:
    """Its left is its right, but the direction stays."""
    return replace(
        lane,
        centre=mirrored_points(lane.centre),
        left=mirrored_points(lane.right),
        right=mirrored_points(lane.left),
        left_neighbour=lane.right_neighbour,
        right_neighbour=lane.left_neighbour,
    )


def mirrored(recording: Recording) -> Recording:
    """A log as it would be in a country that keeps to the other side; which side that is it does not tell."""

    def track(one: RecordedTrack) -> RecordedTrack:
        return one.replace_columns(y=-one.y, yaw=-one.yaw)

    views = tuple(
        replace(view, tracks=tuple(map(track, view.tracks)), pose=view.pose * (1.0, -1.0, -1.0))
        for view in recording.views
    )
    found = recording.map
    lines = tuple(replace(stop, line=mirrored_points(stop.line)) for stop in found.stop_lines)
    lanes = {name: mirrored_lane(lane) for name, lane in found.lanes.items()}
    crosswalks = tuple(map(mirrored_points, found.crosswalks))
    there = replace(found, lanes=lanes, crosswalks=crosswalks, stop_lines=lines, left_hand=None)
    return replace(recording, views=views, map=there)


def motions(recording: Recording) -> list[Float]:
    vehicles = (t for view in recording.views for t in view.tracks if t.category.kind is Kind.VEHICLE)
    return [np.column_stack((track.x, track.y, track.yaw)) for track in vehicles if np.ptp(track.x[track.valid]) > 8]


def same_network(one: NetworkReport, other: NetworkReport) -> None:
    """All that does not depend on the side is as good."""
    assert (other.lanes, other.edges, other.nodes, other.connections) == (
        one.lanes,
        one.edges,
        one.nodes,
        one.connections,
    )
    assert other.drop_reason_by_lane.keys() == one.drop_reason_by_lane.keys()
    assert max(other.deviation.p95, other.deviation.back_p95) <= 0.02


def check_both_sides(recording: Recording, folder: Path) -> None:
    """A right-hand log becomes a right-hand network, its mirror image a left-hand one as good."""
    right = replace(recording, map=replace(recording.map, left_hand=None))
    left = mirrored(recording)
    reports = [
        build_network(log.map, motions(log), folder / name, name, log.dt_s)
        for name, log in (("right", right), ("left", left))
    ]
    assert [report.left_hand for report in reports] == [False, True]
    same_network(*reports)
    roads = load_road_map(folder / "left")
    for lane in roads.driving:
        if lane.left:
            at = lane.centre.length / 2
            assert lane.centre.project(*roads.lanes[lane.left].centre.at(at))[1] > 0.5
            assert roads.lanes[lane.left].right == lane.id
    other = load_road_map(folder / "right")
    for a, b in zip(motions(right), motions(left), strict=True):
        here, there = match_track(a, other), match_track(b, roads)
        assert (here.is_off_road, here.reason) == (there.is_off_road, there.reason)
        assert (
            abs(len(here.route) - len(there.route)) <= 1
        )  # where ways through a junction part the first may be either


@pytest.mark.full
def test_the_mirror_image_of_a_log_keeps_to_the_left(tmp_path: Path) -> None:
    check_both_sides(busy_truth(0, Crowd(vehicles=20, walkers=4, all=30)), tmp_path)


def undirected(found: HdMap) -> HdMap:
    """As V2XPnP tells it: no directions and no neighbours."""
    lanes = found.lanes.items()
    bare = {n: replace(lane, directed=False, left_neighbour="", right_neighbour="") for n, lane in lanes}
    return replace(found, lanes=bare, left_hand=None)


def test_the_side_is_found_without_directions_too(tmp_path: Path) -> None:
    log = busy_truth(0, Crowd(vehicles=12, walkers=4, all=20))
    for side, one in ((False, log), (True, mirrored(log))):
        report = build_network(undirected(one.map), motions(one), tmp_path / str(side), "net")
        assert report.left_hand is side


@pytest.mark.full
@pytest.mark.parametrize("name", ["scene-0103", "scene-0757", "av2-forecasting", "av2-sensor", "peach", "interaction"])
def test_the_mirror_image_of_a_real_log_keeps_to_the_left(name: str, shared_data: Path, tmp_path: Path) -> None:
    check_both_sides(READ[name](), tmp_path)


@pytest.mark.full
@pytest.mark.parametrize("name", ["scene-0757", "scene-1100", "peach"])
def test_the_mirror_image_of_a_real_log_converts_as_well(name: str, shared_data: Path, tmp_path: Path) -> None:
    """Cleaning, matching, fidelity and SUMO's traffic are as good; US-101, one way, tells no side."""
    log = READ[name]()
    found: list[QualityFile] = []
    for one, folder in ((log, "as-it-is"), (mirrored(log), "mirrored")):
        scene = SourceScene(name, log.source, "test", "test", one.map, one)
        found.append(build_quality_file(build_scenario(scene, tmp_path / folder, ConversionOptions()).findings))
    before, after = found
    assert after.network.left_hand is not before.network.left_hand
    assert after.network.lost == before.network.lost
    assert after.fidelity.moving_vehicles == before.fidelity.moving_vehicles
    assert abs(after.fidelity.moving_passed - before.fidelity.moving_passed) <= 1
    assert after.fidelity.wrong_way_frames == before.fidelity.wrong_way_frames
    assert after.fidelity.error_p95 == pytest.approx(before.fidelity.error_p95, abs=0.02)
    assert after.closeness.median_at_5s == pytest.approx(before.closeness.median_at_5s, abs=0.5)

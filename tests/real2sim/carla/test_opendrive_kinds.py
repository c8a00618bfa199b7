"""OpenDRIVE as public files have it: every kind of our own constructions becomes a network, or one sentence."""

import json
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from testing.convert_command import run
from testing.opendrive_samples import (
    CONVERTIBLE,
    MEDIAN,
    NORMALIZED,
    SPIRAL,
    STOP,
    format_crossing,
    format_direct_junction,
    format_geometry,
    format_lane,
    format_map,
    format_road,
    format_section,
    format_width,
)
from testing.sampling import sampled

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap, find_lane_path, load_road_map
from mdrive_sumo.roads.netconvert import run_netconvert
from mdrive_sumo.roads.network_file import read_network_file
from real2sim import netconvert
from real2sim.carla.left_hand_map import mirror_map, mirror_net
from real2sim.carla.opendrive import read_opendrive
from real2sim.carla.reference_line import compute_pose
from real2sim.carla.town_network import build_opendrive_network, make_network_name


def write(folder: Path, text: str, name: str = "Map.xodr") -> Path:
    (folder / name).write_text(text)
    return folder / name


def build(folder: Path, text: str) -> RoadMap:
    build_opendrive_network(write(folder, text), folder / "net")
    return load_road_map(folder / "net")


# --- every kind ---
CHANGED = (
    "namespace",
    "left-hand",
    "a lane that grows at the reference line",
    "a stop sign on a parametric cubic",
    "an arc without curvature",
    "no limit of a lane",
    "ids with slashes",
    "a short road",
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sampled(CONVERTIBLE, CHANGED))  # the others: test_maps_are_read and its repairs
def test_every_kind_becomes_a_network(tmp_path: Path, kind: str) -> None:
    town = build_opendrive_network(write(tmp_path, CONVERTIBLE[kind]), tmp_path / "net")
    assert load_road_map(town.folder).lanes
    assert not town.offset_error_m >= 0.01  # NaN: of a map whose lanes all change their widths


def read_repairs(tmp_path: Path, kind: str) -> tuple[str, ...]:
    return read_opendrive(write(tmp_path, CONVERTIBLE[kind])).repairs


REPAIRS = {
    "plain": (),
    "namespace": (),
    "left-hand": (),
    "elevation": (),
    "junction": (),
    "an arc without curvature": ("road 1: 1 curves of constant curvature written as arcs or lines",),
    "a spiral without curvature": ("road 1: 1 curves of constant curvature written as arcs or lines",),
    "geometry without length": ("road 1: 1 pieces without length left out",),
    "no limit of a lane": ("1 lanes without a speed limit get that of their road",),
    "no junction of a road": ("road 1: taken as outside junctions, which it does not say",),
    "ids with spaces": ("road road a: renamed road_a",),
    "a link to a lost road": ("road 1: its link left out to road 99, which is lost",),
    "a reference to a lost signal": ("signal 404: a reference to it left out, it is not in the map",),
    "a stop sign without its place": ("signal 9: left out, it has no place",),
    "a stop sign behind the end": ("signal 9: moved from s = 150 m to the nearer end of its road",),
    "a signal without orientation": ("signal 9: taken as one of both directions, which it does not say",),
    "direct junction": ("junction 7: 2 connecting roads of 0.1 m put in",),
    "virtual junction": ("junction 7: 1 connections left out that lack one of their roads",),
}


@pytest.mark.parametrize("kind", REPAIRS)
def test_what_is_repaired_is_listed(tmp_path: Path, kind: str) -> None:
    assert read_repairs(tmp_path, kind) == REPAIRS[kind]


@pytest.mark.parametrize("kind", CONVERTIBLE)
def test_maps_are_read_and_a_repaired_map_needs_no_repair(tmp_path: Path, kind: str) -> None:
    first = read_opendrive(write(tmp_path, CONVERTIBLE[kind]))
    again = read_opendrive(write(tmp_path, ElementTree.tostring(first.root, "unicode")))
    assert again.repairs == ()
    assert not again.left_hand


def test_names_that_are_taken_stay_different(tmp_path: Path) -> None:
    roads = (format_road(id_, format_geometry(y=50 * k)) for k, id_ in enumerate(("a b", "a_b", "a/b")))
    root = read_opendrive(write(tmp_path, format_map(*roads))).root
    assert sorted(road.get("id", "") for road in root.iter("road")) == ["a_b", "a_b_", "a_b__"]


@pytest.mark.slow
def test_lanes_that_netconvert_moves_are_counted(tmp_path: Path) -> None:
    """It leaves out a median on the left of the reference line and moves the lanes behind it into its place."""
    median = format_section([format_lane(1, format_width(2), "median"), format_lane(2)], [format_lane(-1)])
    town = build_opendrive_network(write(tmp_path, format_map(format_road(sections=median))), tmp_path / "net")
    assert (town.measured_lanes, town.displaced_lanes) == (2, 1)


@pytest.mark.slow
def test_both_roads_behind_a_direct_junction_are_reached(tmp_path: Path) -> None:
    roads = build(tmp_path, format_direct_junction())
    assert find_lane_path(roads, "-1_1", "-2_0")
    assert find_lane_path(roads, "-1_0", "-3_0")


# --- reference lines ---
@pytest.mark.parametrize(
    ("shape", "length", "s", "wanted"),
    [
        ("<line/>", 100, 40, (40, 0, 0)),
        ('<arc curvature="0.02"/>', 100, 50 * math.pi / 2, (50, 50, math.pi / 2)),
        ('<spiral curvStart="0.02" curvEnd="0.02"/>', 100, 50 * math.pi / 2, (50, 50, math.pi / 2)),
        # Euler's spiral of 1 m with the curvature pi at its end: the Fresnel integrals C(1) and S(1)
        (f'<spiral curvStart="0" curvEnd="{math.pi * 100}"/>', 0.01, 0.01, (0.007798934, 0.004382591, math.pi / 2)),
        ('<poly3 a="0" b="0.75" c="0" d="0"/>', 100, 50, (40, 30, math.atan(0.75))),
        ('<paramPoly3 aU="0" bU="80" cU="0" dU="0" aV="0" bV="60" cV="0" dV="0"/>', 100, 50, (40, 30, math.atan(0.75))),
        (
            '<paramPoly3 pRange="arcLength" aU="0" bU="0.8" cU="0" dU="0" aV="0" bV="0.6" cV="0" dV="0"/>',
            100,
            50,
            (40, 30, math.atan(0.75)),
        ),
    ],
)
def test_poses_of_every_shape(
    tmp_path: Path, shape: str, length: float, s: float, wanted: tuple[float, float, float]
) -> None:
    text = format_map(format_road(geometry=format_geometry(shape, length), length=length))
    (road,) = ElementTree.fromstring(text.partition("?>")[2]).iter("road")
    np.testing.assert_allclose(compute_pose(tmp_path, road, s), wanted, atol=2e-6)


@pytest.mark.parametrize("shape", [SPIRAL, NORMALIZED, '<arc curvature="0.02"/>'])
def test_a_pose_turned_and_moved_is_that_of_the_piece(tmp_path: Path, shape: str) -> None:
    road = ElementTree.fromstring(format_road(geometry=format_geometry(shape, x=7, y=9, hdg=1)))
    plain = ElementTree.fromstring(format_road(geometry=format_geometry(shape)))
    x, y, yaw = compute_pose(tmp_path, plain, 60)
    expected = (7 + x * math.cos(1) - y * math.sin(1), 9 + x * math.sin(1) + y * math.cos(1), yaw + 1)
    np.testing.assert_allclose(compute_pose(tmp_path, road, 60), expected)


# --- left-hand maps ---
ARC = format_geometry('<arc curvature="0.01"/>', x=10, y=20, hdg=0.3)
OFFSET = '<laneOffset s="0" a="0.5" b="0" c="0" d="0"/>'


def locate(s: float, t: float) -> tuple[float, float, float]:
    """Return the pose beside the arc above."""
    yaw = 0.3 + s * 0.01
    x, y = 10 + 100 * (math.sin(yaw) - math.sin(0.3)), 20 - 100 * (math.cos(yaw) - math.cos(0.3))
    return x - t * math.sin(yaw), y + t * math.cos(yaw), yaw


@pytest.mark.slow
def test_lanes_of_a_left_hand_map_lie_and_run_as_it_says(tmp_path: Path) -> None:
    """By the standard, lanes on the right of the reference line run against it where traffic keeps left."""
    stop = STOP.replace('t="-5"', 't="12"')
    lanes = [format_lane(1, format_width(2), "median"), format_lane(2), format_lane(3)]
    sections = format_section(lanes, [format_lane(-1)])
    text = format_map(format_road(geometry=ARC, sections=sections, offset=OFFSET, more='rule="LHT"', signals=stop))
    roads = build(tmp_path, text)
    dx, dy = read_network_file(tmp_path / "net").offset
    assert b' lefthand="true"' in _read_net(tmp_path / "net")
    for t, along in ((0.5 + 2 + 1.75, True), (0.5 + 2 + 5.25, True), (0.5 - 1.75, False)):
        x, y, yaw = locate(50, t)
        near = roads.find_nearest_lanes(np.array([(x + dx, y + dy)]))
        lane = list(roads.lanes.values())[int(near.lane[0])]
        assert near.distance[0] < 0.01
        turned = lane.centre.yaw_at(lane.centre.project(x + dx, y + dy)[0]) - yaw
        assert math.cos(turned) == pytest.approx(1 if along else -1, abs=1e-3)
        if along:
            assert roads.stop_signs is not None
            assert lane.id in {
                box.lane for box in roads.stop_signs
            }  # a sign on the left is of the lanes along the road
    outer = min((lane for lane in roads.lanes.values() if lane.left or lane.right), key=lambda lane: lane.index)
    assert outer.right and not outer.left and len(roads.stop_signs or ()) == 2  # lane 0 is the outer one, on the left


def _read_net(folder: Path) -> bytes:
    import gzip

    return gzip.decompress((folder / "map.net.xml.gz").read_bytes())


@pytest.mark.slow
def test_a_mirrored_net_is_that_of_netconvert_where_its_importer_is_right(tmp_path: Path) -> None:
    """On a map of one lane a direction, netconvert's own left-hand option gives the same lanes and turns."""
    text = format_crossing()
    arguments = ("--opendrive-files", str(write(tmp_path, text)), "--lefthand", *netconvert.OPENDRIVE_OPTIONS)
    own = ElementTree.fromstring(run_netconvert(arguments, tmp_path, "map"))
    build_opendrive_network(write(tmp_path, text.replace("<road ", '<road rule="LHT" ')), tmp_path / "net")
    made = ElementTree.fromstring(_read_net(tmp_path / "net"))
    for net in (own, made):
        assert net.get("lefthand") == "true"
    turns = [
        sorted(
            (one.get("dir"), one.get("state"))
            for one in net.iter("connection")
            if not one.get("from", ":").startswith(":")
        )
        for net in (own, made)
    ]
    assert turns[0] == turns[1]


def test_a_map_mirrored_twice_is_the_map(tmp_path: Path) -> None:
    parts = (format_road(geometry=ARC, sections=MEDIAN, offset=OFFSET, signals=STOP), format_road("2"))
    root = ElementTree.fromstring(format_map(*parts).partition("?>")[2])
    before = read_opendrive(write(tmp_path, ElementTree.tostring(root, "unicode")))
    mirror_map(tmp_path, root)
    mirror_map(tmp_path, root)
    after = read_opendrive(write(tmp_path, ElementTree.tostring(root, "unicode")))
    np.testing.assert_allclose(after.lane_middles, before.lane_middles)
    assert after.stop_signs == before.stop_signs


def test_a_net_mirrored_twice_is_the_net() -> None:
    net = ElementTree.fromstring(
        '<net><location netOffset="1.000,2.000" convBoundary="0.00,0.00,9.00,7.00" '
        'origBoundary="0.00,-2.000,8.00,5.000"/>'
        '<edge id="a"><lane id="a_0" shape="0.000,1.000 5.000,6.500,3.00"/></edge>'
        '<junction id="j" x="0" y="3.000" shape="0.000,0.000 1.000,7.000"/><connection from="a" dir="l"/></net>'
    )
    before = ElementTree.tostring(net)
    mirror_net(net)
    assert [one.get("dir") for one in net.iter("connection")] == ["r"]
    assert [one.get("shape") for one in net.iter("lane")] == ["0.000,6.000 5.000,0.500,3.00"]
    mirror_net(net)
    del net.attrib["lefthand"]
    assert ElementTree.tostring(net) == before


# --- the command ---
@pytest.mark.slow
def test_a_users_map_is_described_as_such(tmp_path: Path) -> None:
    path = write(tmp_path, CONVERTIBLE["left-hand"], "my map (2).xodr")
    done = run("opendrive", path, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    about = read_network_file(tmp_path / "out" / "networks" / "my_map__2_")
    assert about.licence == "unknown"
    assert about.description.startswith("made from the OpenDRIVE map my map (2).xodr; left-hand")
    assert about.origin.startswith("my map (2).xodr of ")
    (town,) = json.loads((tmp_path / "out" / "networks.json").read_text())["networks"]
    assert town["left_hand"]
    assert "my_map__2_ (left-hand)" in (tmp_path / "out" / "networks.md").read_text()


def test_names_of_networks_are_identifiers() -> None:
    names = [
        make_network_name(Path(name)) for name in ("Town05.xodr", "a b.xodr", "é.xodr", ".xodr", "x" * 99 + ".xodr")
    ]
    assert names == ["Town05", "a_b", "map", "xodr", "x" * 80]


@pytest.mark.slow
def test_curves_are_coarser_where_the_fine_ones_need_too_much_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def limited(arguments: tuple[str, ...], folder: Path, expected: str) -> bytes:
        if "1.0" in arguments:
            raise InputError(f"{expected} that netconvert accepts, found: std::bad_alloc")
        return run_netconvert(arguments, folder, expected)

    monkeypatch.setattr(netconvert, "run_netconvert", limited)
    town = build_opendrive_network(write(tmp_path, CONVERTIBLE["a stop sign on a spiral"]), tmp_path / "net")
    assert town.repairs == ("curves in steps of 2 m: with 1 m netconvert runs out of memory",)
    build_arguments = read_network_file(town.folder).build
    assert build_arguments[build_arguments.index("--opendrive.curve-resolution") + 1] == "2.0"


def test_the_middle_of_the_innermost_lane_is_measured(tmp_path: Path) -> None:
    one = format_map(format_road(sections=format_section([], [format_lane(-1)])))
    np.testing.assert_allclose(read_opendrive(write(tmp_path, one)).lane_middles, [(50, -1.75)])

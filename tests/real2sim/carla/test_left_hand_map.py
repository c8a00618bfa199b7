"""Left-hand OpenDRIVE maps: mirrored, compiled, mirrored back."""

import gzip
import math
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from testing.opendrive_samples import (
    MEDIAN,
    STOP,
    format_crossing,
    format_geometry,
    format_lane,
    format_map,
    format_road,
    format_section,
    format_width,
)

from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.roads.netconvert import find_netconvert, run_netconvert
from mdrive_sumo.roads.network_file import read_network_file
from real2sim.carla import town_network
from real2sim.carla.left_hand_map import mirror_map, mirror_net
from real2sim.carla.opendrive import read_opendrive
from real2sim.carla.town_network import build_opendrive_network


def write(folder: Path, text: str) -> Path:
    (folder / "Map.xodr").write_text(text)
    return folder / "Map.xodr"


def build(folder: Path, text: str) -> RoadMap:
    build_opendrive_network(write(folder, text), folder / "net")
    return load_road_map(folder / "net")


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
    return gzip.decompress((folder / "map.net.xml.gz").read_bytes())


@pytest.mark.slow
def test_a_mirrored_net_is_that_of_netconvert_where_its_importer_is_right(tmp_path: Path) -> None:
    """On a map of one lane a direction, netconvert's own left-hand option gives the same lanes and turns."""
    text = format_crossing()
    arguments = ("--opendrive-files", str(write(tmp_path, text)), "--lefthand", *town_network.OPENDRIVE_OPTIONS)
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


@pytest.mark.slow
def test_sumo_drives_on_the_left_of_a_mirrored_network(tmp_path: Path) -> None:
    build_opendrive_network(write(tmp_path, format_crossing().replace("<road ", '<road rule="LHT" ')), tmp_path / "net")
    (tmp_path / "map.net.xml").write_bytes(_read_net(tmp_path / "net"))
    trips = "".join(
        f'<trip id="{name}" depart="0" from="{start}" to="{end}"/>'
        for name, start, end in (("east", "-1", "-2"), ("west", "2", "1"))
    )
    (tmp_path / "trips.xml").write_text(f"<routes>{trips}</routes>")
    call = (find_netconvert().with_name("sumo"), "-n", "map.net.xml", "-r", "trips.xml", "--fcd-output", "fcd.xml")
    subprocess.run([*call, "--end", "60"], cwd=tmp_path, check=True, capture_output=True)
    points = list(ElementTree.parse(tmp_path / "fcd.xml").iter("vehicle"))
    for name, side in (("east", 1.75), ("west", -1.75)):
        track = [(float(one.get("x", "")), float(one.get("y", ""))) for one in points if one.get("id") == name]
        assert len(track) > 5
        assert all(y == pytest.approx(side, abs=0.01) for _, y in track)
        assert (track[-1][0] - track[0][0]) * side > 0


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
        '<junction id="j" x="0" y="3.000" customShape="1" shape="0.000,0.000 1.000,7.000"/>'
        '<connection from="a" dir="l"/></net>'
    )
    before = ElementTree.tostring(net)
    mirror_net(net)
    assert [one.get("dir") for one in net.iter("connection")] == ["r"]
    assert [one.get("shape") for one in net.iter("lane")] == ["0.000,6.000 5.000,0.500,3.00"]
    mirror_net(net)
    del net.attrib["lefthand"]
    assert ElementTree.tostring(net) == before

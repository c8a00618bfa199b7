"""Own maps become networks: what they keep, what they list, and what is refused in one sentence."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner
from testing.made_network import compile_tee
from testing.opendrive_samples import format_map, format_road
from testing.osm_samples import OsmDraft, draw_crossing

import mdrive_sumo as md
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.route_junctions import find_junctions
from mdrive_sumo.worlds.authoring.route_steps import build_route
from real2sim.own_maps import ConvertedMap, convert_map
from real2sim.own_maps.map_file import MAX_MAP_BYTES


def convert(folder: Path, name: str, content: str | bytes, **options: bool) -> tuple[ConvertedMap, RoadMap]:
    """Convert a file of that name and content."""
    data = content.encode() if isinstance(content, str) else content
    (folder / name).write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    found = convert_map(folder / name, folder / "network", **options)
    return found, md.worlds.load(found.folder).roads


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[ConvertedMap, RoadMap]:
    return convert(tmp_path_factory.mktemp("osm"), "town.osm", draw_crossing().write())


def test_an_extract_keeps_roads_limits_buildings_signs_and_signals(crossing: tuple[ConvertedMap, RoadMap]) -> None:
    found, roads = crossing
    assert (found.name, found.buildings, found.stop_signs, found.signals) == ("town", 1, 1, 1)
    limits = {name: round(lane.speed_limit * 3.6) for name, lane in roads.lanes.items() if not lane.junction}
    assert (limits["100#0_1"], limits["101_0"]) == (50, 30)
    (house,) = roads.building_shapes
    assert house.area == pytest.approx(20 * 15, rel=0.01)
    street = roads.lanes["100#1_1"].centre
    assert house.distance(shapely.LineString(street.xy)) == pytest.approx(15 + 1.6, abs=0.7), "15 m from the middle"
    assert [sign.lane for sign in roads.yield_signs] == ["-102_0"]
    assert len(roads.crossings) == 2, "one across each lane"


@pytest.mark.parametrize(
    ("steps", "kind"),
    [
        ("101_0 -30 > 102_0 20", "stop"),
        ("-102_0 -30 > -101_0 20", "yield"),
        ("100#0_1 -30 > 100#1_1 20", "priority-road"),
        ("104#0_0 -30 > 104#1_0 20", "traffic-light"),
    ],
)
def test_the_signs_of_an_extract_give_the_right_of_way(
    crossing: tuple[ConvertedMap, RoadMap], steps: str, kind: str
) -> None:
    roads = crossing[1]
    route = build_route(roads, steps)
    assert [one.kind for one in find_junctions(route.lanes, roads, Polyline(route.xy))] == [kind]


def test_what_an_extract_does_not_say_is_listed(crossing: tuple[ConvertedMap, RoadMap]) -> None:
    found, _ = crossing
    report = (found.folder / "conversion.md").read_text()
    for line in (
        "side of the road: OpenStreetMap does not say it, taken as right",
        "speed limits: 1 of 5 roads have none in the extract",
        "lanes: 3 of 5 roads do not say how many",
        "ways that cars do not use: 1 footway; footways are drawn only",
        "signals: 1 nodes; their programs are netconvert's",
    ):
        assert line in "\n".join(found.lost) and line in report
    assert found.drivability.findings == ()


def test_a_cav_drives_on_an_extract(crossing: tuple[ConvertedMap, RoadMap], tmp_path: Path) -> None:
    draft = md.worlds.load(crossing[0].folder).new_scenario("left_turn")
    draft.add_cav("101_0 -30 > -100#0_1 20")
    suite = md.load_suite(str(draft.save(tmp_path / "suite")))
    with md.Simulation("left_turn", suite=suite) as simulation:
        assert simulation.reset()["cav0"].own.speed == pytest.approx(0.0, abs=0.1)


def test_what_is_no_wall_and_what_stands_above_a_road_is_left_out(tmp_path: Path) -> None:
    draft = draw_crossing()
    for name, x in ((50, 60.0), (60, 90.0)):
        corners = [(x, -8.0), (x + 9, -8.0), (x + 9, 8.0), (x, 8.0)]
        nodes = tuple(draft.add_node(name + k, *corner) for k, corner in enumerate(corners))
        draft.add_way(name, (*nodes, nodes[0]), {"building": "yes" if name == 50 else "roof"})
    draft.add_way(70, (20, 21, 999), {"building": "yes"})
    found, roads = convert(tmp_path, "town.osm.gz", draft.write())
    assert len(roads.buildings) == 1
    listed = "\n".join(found.lost)
    assert "buildings: 1 left out, above a lane" in listed
    assert "buildings: 1 left out, without walls or tiny" in listed
    assert "ways: 1 are cut off by the extract or broken" in listed


def test_an_all_way_stop_stands_on_its_junction(tmp_path: Path) -> None:
    draft = OsmDraft()
    for name, x, y in ((1, -90, 0), (3, 90, 0), (4, 0, -90), (5, 0, 90)):
        draft.add_node(name, x, y)
    draft.add_node(2, 0, 0, highway="stop", stop="all")
    draft.add_way(10, (1, 2, 3), {"highway": "residential"})
    draft.add_way(11, (4, 2, 5), {"highway": "residential"})
    found, roads = convert(tmp_path, "town.osm", draft.write())
    assert set(roads.junction_controls.values()) == {"all-way-stop"}
    assert found.stop_signs == 4


def keeps_left(roads: RoadMap, lane: str, opposite: str) -> bool:
    """Return whether the opposite lane lies to the right of a lane."""
    x, y = roads.lanes[opposite].centre.at(40.0)
    return roads.lanes[lane].centre.project(x, y)[1] < 0.0


def test_traffic_keeps_left_where_the_user_or_a_road_says_so(tmp_path: Path) -> None:
    for name, options, tags in (("a", {"left_hand": True}, {}), ("b", {}, {"driving_side": "left"}), ("c", {}, {})):
        (tmp_path / name).mkdir()
        _, roads = convert(tmp_path / name, "town.osm", draw_crossing(**tags).write(), **options)
        assert keeps_left(roads, "100#0_1", "-100#0_1") is (name != "c")


def test_an_own_net_is_kept_and_says_what_it_lacks(tmp_path: Path) -> None:
    found, roads = convert(tmp_path, "tee.net.xml.gz", compile_tee(tmp_path / "plain"))
    assert found.name == roads.name == "tee"
    assert {"w_in_0", "s_out_0"} <= set(roads.lanes)
    assert (found.drivability.lanes, found.drivability.junctions, found.stop_signs) == (6, 1, None)
    assert any(line.startswith("buildings and signs") for line in found.lost)


def test_a_net_far_from_the_origin_is_moved_and_remembers_by_how_much(tmp_path: Path) -> None:
    """Nets in UTM coordinates lie 5 800 km north; the middle of the T junction lies at (80, 80) of its own."""
    net = compile_tee(tmp_path / "plain")
    near, _ = convert(tmp_path, "near.net.xml", net)
    far = re.sub(rb'(?<= shape=")[^"]+', lambda shape: shift(shape[0], 391_240.0, 5_817_705.0), net)
    far = re.sub(rb'(<junction [^>]* x=")([^"]+)(" y=")([^"]+)', shift_junction, far)
    (tmp_path / "moved").mkdir()
    found, roads = convert(tmp_path / "moved", "far.net.xml", far)
    assert roads.log_origin == (391_000.0, 5_817_000.0)
    before = md.worlds.load(near.folder).roads.lanes["w_in_0"].centre.xy
    assert roads.lanes["w_in_0"].centre.xy == pytest.approx(before + np.array((240.0, 705.0)), abs=0.01)
    assert "coordinates: moved by (-391000, -5817000) m" in "\n".join(found.lost)


def shift(shape: bytes, x: float, y: float) -> bytes:
    points = [[float(number) for number in point.split(b",")] for point in shape.split()]
    return " ".join(f"{px + x:.2f},{py + y:.2f}" for px, py in points).encode()


def shift_junction(found: re.Match[bytes]) -> bytes:
    x, y = float(found[2]) + 391_240.0, float(found[4]) + 5_817_705.0
    return found[1] + f"{x:.2f}".encode() + found[3] + f"{y:.2f}".encode()


def test_an_opendrive_map_is_read_packed_too(tmp_path: Path) -> None:
    found, roads = convert(tmp_path, "road.xodr.gz", format_map(format_road()))
    assert found.name == "road" and roads.driving


LOCATION = '<location netOffset="0,0" convBoundary="0,0,9,9" origBoundary="0,0,9,9" projParameter="!"/>'
NET = f'<net version="1.20">{LOCATION}{{}}</net>'
LANE = (
    '<edge id="e" from="a" to="b"><lane id="e_0" index="0" speed="9" length="{length}" shape="{shape}"{more}/></edge>'
)
NODES = '<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape=""/>' + (
    '<junction id="b" type="dead_end" x="9" y="0" incLanes="e_0" intLanes="" shape=""/>'
)


def make_net(length: float = 90.0, shape: str = "0,0 90,0", more: str = "") -> str:
    return NET.format(LANE.format(length=length, shape=shape, more=more) + NODES)


BAD: dict[str, tuple[str, str | bytes, str]] = {
    "nothing": ("a.osm", "", "expected well-formed XML, found: no element found"),
    "broken": ("a.net.xml", "<net><edge", "expected well-formed XML"),
    "cut": ("a.osm.gz", gzip.compress(b"<osm/>" * 50)[:-12], "cannot be unpacked"),
    "document type": ("a.osm", '<!DOCTYPE a [<!ENTITY b "c">]><osm>&b;</osm>', "without a document type"),
    "routes": ("a.xml", "<routes/>", "found <routes>; these are SUMO's vehicles, its net is in another file"),
    "picture": ("a.osm", b"\x89PNG\r\n\x1a\n", "expected well-formed XML"),
    "net without lanes": ("a.net.xml", NET.format(""), "expected lanes with shapes, found none"),
    "net without lanes for cars": (
        "a.net.xml",
        make_net(more=' allow="pedestrian"'),
        "expected lanes that cars may use, found none",
    ),
    "short net": ("a.net.xml", make_net(9.0, "0,0 9,0"), "a way of at least 30 m over connected lanes, found 9.0 m"),
    "huge coordinates": ("a.net.xml", make_net(shape="0,0 1e300,0"), "within 200 km of each other, found"),
    "no coordinates": ("a.net.xml", make_net(shape="0,0 nan,0"), "shape of a lane: expected a finite number"),
    "extract without roads": (
        "a.osm",
        '<osm><node id="1" lat="1" lon="1"/><way id="2"><nd ref="1"/><tag k="building" v="yes"/></way></osm>',
        "expected roads .ways with highway=residential, primary, ....,* found none among 1 ways",
    ),
    "extract without nodes": (
        "a.osm",
        '<osm><way id="2"><nd ref="1"/><tag k="highway" v="primary"/></way></osm>',
        "expected the nodes of its roads, found none",
    ),
    "extract of a country": (
        "a.osm",
        '<osm><node id="1" lat="1" lon="1"/><node id="2" lat="9" lon="1"/><way id="2"><nd ref="1"/><nd ref="2"/>'
        '<tag k="highway" v="primary"/></way></osm>',
        "expected roads within 1 degree of each other, found 8.00; cut a smaller part out",
    ),
    "extract off the earth": (
        "a.osm",
        '<osm><node id="1" lat="91" lon="1"/><way id="2"><nd ref="1"/><tag k="highway" v="primary"/></way></osm>',
        "latitudes within 90",
    ),
    "OpenDRIVE without lanes": ("a.xodr", '<OpenDRIVE><header revMajor="1"/></OpenDRIVE>', "a.xodr: "),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_map_is_one_sentence_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    file, content, sentence = BAD[name]
    (tmp_path / file).write_bytes(content.encode() if isinstance(content, str) else content)
    done = CliRunner().invoke(main, ["convert", "network", str(tmp_path / file), "--out", str(tmp_path / "out")])
    assert done.exit_code == 2, (done.output, done.exception)
    assert re.search(sentence, done.output), done.output
    assert len(done.output.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == [file]


REFUSALS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no file": (lambda folder: convert_map(folder / "no.osm", folder / "out"), "cannot be read: No such file"),
    "a folder": (lambda folder: convert_map(folder, folder / "out"), "cannot be read: Is a directory"),
    "a name": (lambda folder: convert_map(folder / "no.osm", folder / "out", "a b"), "--name: expected up to 80"),
    "a side": (lambda folder: convert(folder, "a.net.xml", make_net(), left_hand=True), "a SUMO net says it itself"),
    "too large": (lambda folder: convert(folder, "a.osm.gz", b" " * (MAX_MAP_BYTES + 1)), "at most 67108864 bytes"),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_a_refusal_is_one_sentence(tmp_path: Path, name: str) -> None:
    make, sentence = REFUSALS[name]
    with pytest.raises(InputError, match=sentence):
        make(tmp_path)


def test_the_command_says_what_to_do_next(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(draw_crossing().write())
    done = CliRunner().invoke(main, ["convert", "network", str(tmp_path / "town.osm"), "--out", str(tmp_path / "net")])
    assert done.exit_code == 0, done.output
    assert "town: OpenStreetMap extract, 16 lanes of 1.8 km, 2 junctions, 1 traffic lights, 1 stop signs" in done.output
    assert f"mdrive-sumo view {tmp_path / 'net'}" in done.output

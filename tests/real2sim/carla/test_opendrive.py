"""OpenDRIVE: poses on reference lines, stop signs on lanes, towns through netconvert."""

import gzip
import json
import math
import os
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from testing.opendrive_samples import REFUSED
from testing.sampling import sampled
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from real2sim.carla import town_network
from real2sim.carla.map_repairs import repair_road_links
from real2sim.carla.opendrive import read_opendrive
from real2sim.carla.opendrive_converter import convert_opendrive, write_networks_report
from real2sim.carla.town_network import TownNetwork, build_town_network

pytestmark = pytest.mark.slow

MAPS = SHARED_DATA / "carla_towns"

ROAD = """
<OpenDRIVE><header revMajor="1" revMinor="4" date="today"/>
<road id="7" junction="-1" length="{length}"><planView>{geometry}</planView>
<lanes>{offset}<laneSection s="0">
<left><lane id="1" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes><signals>{signals}</signals></road></OpenDRIVE>
"""
LINE = '<geometry s="0" x="10" y="20" hdg="0.3" length="60"><line/></geometry>'
ARC = '<geometry s="0" x="10" y="20" hdg="0.3" length="60"><arc curvature="0.02"/></geometry>'
SIGN = '<signal id="{id}" s="{s}" t="{t}" type="206" orientation="+" dynamic="no"/>'


def xodr(folder: Path, geometry: str = LINE, signals: str = "", offset: str = "", name: str = "TownXX") -> Path:
    path = folder / f"{name}.xodr"
    path.write_text(ROAD.format(length=60, geometry=geometry, signals=signals, offset=offset))
    return path


def test_signs_stand_where_the_road_says_and_concern_the_traffic_on_their_side(tmp_path: Path) -> None:
    right, left = SIGN.format(id="r", s=50, t=-5), SIGN.format(id="l", s=10, t=5)
    signs = read_opendrive(xodr(tmp_path, signals=right + left)).stop_signs
    assert signs is not None
    by_id = {sign.id: sign for sign in signs}
    assert by_id["r"].yaw == pytest.approx(0.3)
    assert by_id["l"].yaw == pytest.approx(wrap_angle(0.3 + math.pi))
    assert by_id["r"].x == pytest.approx(10 + 50 * math.cos(0.3) + 5 * math.sin(0.3))
    assert by_id["r"].y == pytest.approx(20 + 50 * math.sin(0.3) - 5 * math.cos(0.3))


def test_an_arc_turns_by_curvature_times_length(tmp_path: Path) -> None:
    signs = read_opendrive(xodr(tmp_path, ARC, SIGN.format(id="r", s=50, t=-1e-9))).stop_signs
    assert signs is not None
    centre = (10 - 50 * math.sin(0.3), 20 + 50 * math.cos(0.3))
    assert signs[0].yaw == pytest.approx(0.3 + 1.0)
    assert math.dist((signs[0].x, signs[0].y), centre) == pytest.approx(50.0)


def test_without_any_signal_the_signs_are_unknown_not_none(tmp_path: Path) -> None:
    light = '<signal id="1" s="1" t="1" type="1000001" orientation="+" dynamic="no"/>'
    assert read_opendrive(xodr(tmp_path)).stop_signs is None
    assert read_opendrive(xodr(tmp_path, signals=light)).stop_signs == ()


@pytest.mark.parametrize("geometry", [LINE, ARC])
def test_a_map_is_compiled_with_its_signs(tmp_path: Path, geometry: str) -> None:
    signals = SIGN.format(id="r", s=50, t=-5) + SIGN.format(id="l", s=10, t=5) + SIGN.format(id="far", s=9, t=60)
    xodr(tmp_path, geometry, signals)
    town = build_town_network("TownXX", tmp_path, tmp_path / "net")
    roads = load_road_map(town.folder)
    assert town.stop_signs == 2
    assert town.unplaced_signs == ("far",)
    assert town.offset_error_m < 0.01
    assert roads.stop_signs is not None
    for box in roads.stop_signs:  # both signs stand 10 m before the end of their lane; an outer lane is longer
        assert box.line_pos_m / roads.lanes[box.lane].centre.length == pytest.approx(50 / 60, abs=0.01)
    assert len({box.lane for box in roads.stop_signs}) == 2


def test_the_offset_is_checked_with_lanes_that_do_not_begin_at_the_reference_line(tmp_path: Path) -> None:
    xodr(
        tmp_path,
        offset='<laneOffset s="0" a="-1.7" b="0" c="0" d="0"/>',
        signals=SIGN.format(id="r", s=5, t=-9),
    )
    assert build_town_network("TownXX", tmp_path, tmp_path / "net").offset_error_m < 0.01


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    xodr(tmp_path)
    first, second = (build_town_network("TownXX", tmp_path, tmp_path / name).folder for name in ("a", "b"))
    assert (first / "map.net.xml.gz").read_bytes() == (second / "map.net.xml.gz").read_bytes()
    assert (first / "network.json").read_bytes() == (second / "network.json").read_bytes()
    assert b"<!--" not in gzip.decompress((first / "map.net.xml.gz").read_bytes())


def test_a_ready_net_is_taken_where_the_xodr_is_missing_or_predates_signals(tmp_path: Path) -> None:
    xodr(tmp_path, signals=SIGN.format(id="r", s=50, t=-5))
    with_signs = build_town_network("TownXX", tmp_path, tmp_path / "first")
    (tmp_path / "TownXX.net.xml").write_bytes(gzip.decompress((with_signs.folder / "map.net.xml.gz").read_bytes()))
    assert build_town_network("TownXX", tmp_path, tmp_path / "both").source.startswith("TownXX.xodr")
    xodr(tmp_path)
    assert build_town_network("TownXX", tmp_path, tmp_path / "old").source.startswith("ready net")
    (tmp_path / "TownXX.xodr").unlink()
    ready = build_town_network("TownXX", tmp_path, tmp_path / "ready")
    assert ready.stop_signs is None
    assert ready.offset == with_signs.offset
    assert read_network_file(ready.folder).stop_signs is None
    assert load_road_map(ready.folder).lanes.keys() == load_road_map(with_signs.folder).lanes.keys()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("<OpenDRIVE><road", "well-formed XML"),
        ("<net/>", "root element <OpenDRIVE>"),
        ("<!DOCTYPE bomb [<!ENTITY a 'aaa'>]><OpenDRIVE>&a;</OpenDRIVE>", "without a document type"),
        (ROAD.format(length="nan", geometry=LINE, signals="", offset=""), "length: expected a finite number"),
        ("<OpenDRIVE><header/></OpenDRIVE>", "netconvert"),
        *((text, re.escape(words)) for text, words in REFUSED.values()),
    ],
)
def test_a_bad_map_is_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "TownXX.xodr").write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        build_town_network("TownXX", tmp_path, tmp_path / "net")
    assert "TownXX.xodr" in str(caught.value)


def two_roads(link: str) -> str:
    """A road of 60 m and one of 40 m behind it, whose own link is the given one."""
    whole = ROAD.format(length=60, geometry=LINE, signals="", offset="")
    end = f'{10 + 60 * math.cos(0.3)!r}" y="{20 + 60 * math.sin(0.3)!r}'
    first = whole[whole.index("<road") : whole.index("</OpenDRIVE>")]
    second = first.replace('id="7"', 'id="8"').replace('"60"', '"40"').replace('10" y="20', end)
    ahead = '<link><successor elementType="road" elementId="8" contactPoint="start"/></link>'
    for sign in ("1", "-1"):
        lane = f'<lane id="{sign}" type="driving" level="false"><link/>'
        first = first.replace(lane, lane.replace("<link/>", f'<link><successor id="{sign}"/></link>'))
    roads = first.replace("<planView>", f"{ahead}<planView>") + second.replace("<planView>", f"{link}<planView>")
    return f'<OpenDRIVE><header revMajor="1" revMinor="4"/>{roads}</OpenDRIVE>'


@pytest.mark.parametrize(
    ("link", "was"),
    [
        ("", "nothing"),
        ("<link/>", "nothing"),
        ('<link><predecessor elementType="junction" elementId="9"/></link>', "junction 9"),
        ('<link><predecessor elementType="road" elementId="9" contactPoint="end"/></link>', "road 9"),
    ],
)
def test_a_one_sided_link_is_repaired(tmp_path: Path, link: str, was: str) -> None:
    (tmp_path / "TownXX.xodr").write_text(two_roads(link))
    town = build_town_network("TownXX", tmp_path, tmp_path / "net")
    assert town.repairs == (f"road 8: its predecessor is road 7, which says so, not {was}",)
    assert find_lane_path(load_road_map(town.folder), "-7_0", "-8_0")
    assert find_lane_path(load_road_map(town.folder), "8_0", "7_0")
    assert "(mended: road 8" in networks_report(tmp_path, town)


def networks_report(folder: Path, town: TownNetwork) -> str:
    write_networks_report([town], folder)
    return (folder / "networks.md").read_text()


def test_two_sided_links_are_unchanged() -> None:
    both = '<link><predecessor elementType="road" elementId="7" contactPoint="end"/></link>'
    root = ElementTree.fromstring(two_roads(both))
    before = ElementTree.tostring(root)
    assert repair_road_links(root) == ()
    assert ElementTree.tostring(root) == before


def test_maps_become_networks_ready_for_scenarios(tmp_path: Path) -> None:
    maps = [xodr(tmp_path, signals=SIGN.format(id="r", s=50, t=-5)), xodr(tmp_path, ARC, name="Other")]
    towns = convert_opendrive(maps, tmp_path / "out")
    assert [town.name for town in towns] == ["TownXX", "Other"]
    for name in ("TownXX", "Other"):
        assert load_road_map(find_network_folder(name, tmp_path / "out")).name == name
    found = json.loads((tmp_path / "out" / "networks.json").read_text())["networks"]
    assert [network["stop_signs"] for network in found] == [1, None]
    assert all(network["offset_error_m"] < 0.01 for network in found)
    assert "signs unknown" in (tmp_path / "out" / "networks.md").read_text()


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ((), "expected maps of different names, found no map"),
        (("TownXX", "TownXX"), "expected maps of different names, found TownXX"),
        (("TownXX", "Broken"), "Broken.xodr: expected well-formed XML"),
        (("TownXX", "Missing"), "Missing.xodr: cannot be read: No such file"),
    ],
)
def test_maps_that_cannot_be_converted_leave_nothing(tmp_path: Path, names: tuple[str, ...], sentence: str) -> None:
    xodr(tmp_path)
    (tmp_path / "Broken.xodr").write_text("<OpenDRIVE>")
    with pytest.raises(InputError, match=sentence):
        convert_opendrive([tmp_path / f"{name}.xodr" for name in names], tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["Broken.xodr", "TownXX.xodr"]


def test_a_missing_town_names_both_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected Town05\.xodr or Town05\.net\.xml, found neither"):
        build_town_network("Town05", tmp_path, tmp_path / "net")


def test_a_net_without_an_offset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "TownXX.net.xml").write_text("<net/>")
    with pytest.raises(InputError, match="netOffset"):
        build_town_network("TownXX", tmp_path, tmp_path / "net")


def test_without_netconvert_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    xodr(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setitem(os.environ, "PATH", "")
    with pytest.raises(InputError, match=r"pip install '\.\[convert\]'"):
        build_town_network("TownXX", tmp_path, tmp_path / "net")


@needs_data
@pytest.mark.parametrize("name", sampled((f"Town0{n}" for n in range(1, 8)), ("Town07",)))
def test_the_offset_of_every_carla_town_is_right_to_a_centimetre(tmp_path: Path, name: str) -> None:
    town = build_town_network(name, MAPS, tmp_path / "net")
    assert town.offset_error_m < 0.01
    assert town.stop_signs == {"Town03": None, "Town05": None, "Town07": 19}.get(name, 0)


@needs_data
def test_the_19_stop_signs_of_town07_stand_shortly_before_a_junction(tmp_path: Path) -> None:
    roads = load_road_map(build_town_network("Town07", MAPS, tmp_path / "net").folder)
    assert roads.stop_signs is not None
    for box in roads.stop_signs:
        lane = roads.lanes[box.lane]
        assert lane.successors and all(roads.lanes[after].junction for after in lane.successors)
        assert lane.centre.length - 5.0 < box.line_pos_m <= lane.centre.length


@pytest.mark.parametrize("length", ["1e9", "1e300", "-1e12"])
def test_roads_that_fill_the_memory_are_refused(length: str, tmp_path: Path) -> None:
    """netconvert and the reader make a point for every metre."""
    path = xodr(tmp_path, LINE.replace('length="60"', f'length="{length}"'))
    with pytest.raises(InputError, match=r"TownXX\.xodr: expected roads of at most 1e\+06 m in all, found "):
        read_opendrive(path)


def test_netconvert_runs_with_a_limit_of_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdrive_sumo.roads.netconvert.MEMORY_BYTES", 64 * 2**20)
    with pytest.raises(InputError, match=r"TownXX\.xodr: expected a map that netconvert accepts, found: "):
        town_network.compile_opendrive(xodr(tmp_path))

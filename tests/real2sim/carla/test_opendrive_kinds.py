"""OpenDRIVE as public files have it: every kind of our own constructions becomes a network, or one sentence."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from testing.convert_command import run
from testing.opendrive_samples import (
    CONVERTIBLE,
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
from real2sim.carla import town_network
from real2sim.carla.opendrive import read_opendrive
from real2sim.carla.town_network import build_opendrive_network, build_town_network, make_network_name


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "licence"), [("Town99", "not stated in the file; the CARLA project"), ("my_town", "unknown")]
)
def test_only_towns_of_carla_have_its_licence(name: str, licence: str, tmp_path: Path) -> None:
    write(tmp_path, CONVERTIBLE["plain"], f"{name}.xodr")
    about = read_network_file(build_town_network(name, tmp_path, tmp_path / "net").folder)
    assert about.licence.startswith(licence)
    assert about.description.startswith("CARLA Town99" if name == "Town99" else "town my_town of a scenario")


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

    monkeypatch.setattr(town_network, "run_netconvert", limited)
    town = build_opendrive_network(write(tmp_path, CONVERTIBLE["a stop sign on a spiral"]), tmp_path / "net")
    assert town.repairs == ("curves in steps of 2 m: with 1 m netconvert runs out of memory",)
    build_arguments = read_network_file(town.folder).build
    assert build_arguments[build_arguments.index("--opendrive.curve-resolution") + 1] == "2.0"


def test_the_middle_of_the_innermost_lane_is_measured(tmp_path: Path) -> None:
    one = format_map(format_road(sections=format_section([], [format_lane(-1)])))
    np.testing.assert_allclose(read_opendrive(write(tmp_path, one)).lane_middles, [(50, -1.75)])

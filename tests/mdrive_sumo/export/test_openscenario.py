"""OpenSCENARIO, checked by ASAM's own checker; its OpenDRIVE map, read by netconvert."""

import importlib
import logging
import subprocess
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib
from testing.mixed_run import GUEST, SCENARIO

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.roads.netconvert import find_netconvert

from .conftest import Export

pytestmark = pytest.mark.slow  # of an episode that is driven

Element = Any
"""An element of which the test knows that its parts are there."""


@pytest.fixture(scope="module")
def storyboard() -> ModuleType:
    """Imported here: its library needs a second, and every process of the tests collects this module."""
    return importlib.import_module("mdrive_sumo.export.openscenario_storyboard")


@pytest.fixture(scope="module")
def path(exported: Export) -> Path:
    return exported("openscenario") / f"{SCENARIO}.xosc"


@pytest.fixture(scope="module")
def root(path: Path) -> Element:
    return ElementTree.parse(path).getroot()


def test_the_checker_of_asam_finds_nothing(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Seventeen rules, the published schema of version 1.2 among them."""
    from qc_baselib import Configuration, Result, StatusType
    from qc_openscenario import constants
    from qc_openscenario.main import run_checks

    config, result = Configuration(), Result()
    config.set_config_param("InputFile", str(path))
    config.register_checker_bundle(constants.BUNDLE_NAME)
    result.register_checker_bundle(name=constants.BUNDLE_NAME, description="", version="1", summary="")
    with caplog.at_level(logging.ERROR):
        run_checks(config, result)
    checkers = [one.checker_id for one in result.get_checker_bundle_result(constants.BUNDLE_NAME).checkers]
    assert any("valid_schema" in name for name in checkers) and len(checkers) >= 15
    assert {result.get_checker_status(name) for name in checkers} == {StatusType.COMPLETED}
    assert result.get_issue_count() == 0


def read_positions(parent: Element) -> np.ndarray:
    return np.array([[float(one.get(name)) for name in ("x", "y", "h")] for one in parent.iter("WorldPosition")])


def test_trajectories_pass_the_recorded_centres_at_their_times(root: Element, record: EpisodeRecord) -> None:
    """A vertex is the reference point; the centre of the box lies so far ahead of it as the entity says."""
    ahead = {one.get("name"): float(one.find(".//Center").get("x")) for one in root.iter("ScenarioObject")}
    assert ahead["0"] == 1.4225 and ahead["walker"] == ahead["cone"] == 0.0
    groups = {one.find(".//EntityRef").get("entityRef"): one for one in root.iter("ManeuverGroup")}
    assert set(groups) == set(record.ids)
    for id_, group in groups.items():
        column, trajectory = record.ids.index(id_), group.find(".//Trajectory")
        ticks = [round(float(one.get("time")) * 20) for one in trajectory.iter("Vertex")]
        assert ticks == np.flatnonzero(record.valid[:, column]).tolist()
        x, y, yaw = read_positions(trajectory).T
        centre = x + ahead[id_] * np.cos(yaw), y + ahead[id_] * np.sin(yaw)
        gap = np.hypot(centre[0] - record.x[ticks, column], centre[1] - record.y[ticks, column])
        assert gap.max() < 1e-3
        assert (np.cos(yaw - record.yaw[ticks, column]) > 1 - 1e-9).all()


def test_entities_appear_and_leave_in_their_ticks(root: Element) -> None:
    times = {
        event.get("name"): float(event.find(".//SimulationTimeCondition").get("value")) for event in root.iter("Event")
    }
    assert (times["guest appears"], times["guest leaves"]) == (GUEST[0], GUEST[1] + 0.05)
    assert [one.get("entityRef") for one in root.iter("AddEntityAction")] == ["late", "guest"] or len(times) > 2
    assert {one.get("entityRef") for one in root.iter("Private")} == {"0", "1", "cone", "cyclist", "truck", "walker"}


def test_netconvert_reads_the_map_back(path: Path, root: Element, tmp_path: Path, recording: ScoredRecording) -> None:
    """In the frame of the episode: netconvert moves what it reads so that it begins at 0, and says by how much."""
    xodr = path.parent / str(root.find("RoadNetwork/LogicFile").get("filepath"))
    call = (find_netconvert(), "--opendrive-files", xodr, "--output-file", tmp_path / "back.net.xml")
    subprocess.run([*call, "--opendrive.curve-resolution", "1", "--precision", "4"], check=True, capture_output=True)
    net = sumolib.net.readNet(str(tmp_path / "back.net.xml"))
    lines = [shapely.LineString(lane.getShape()) for edge in net.getEdges() for lane in edge.getLanes()]
    tree, offset = shapely.STRtree(lines), np.array(net.getLocationOffset())
    for lane in recording.roads.driving:
        if not lane.junction:
            middle = shapely.Point(offset + lane.centre.at(lane.centre.length / 2))
            assert lines[int(tree.nearest(middle))].distance(middle) < 0.03


def test_the_map_has_only_what_its_version_has_and_no_date(storyboard: ModuleType) -> None:
    """ASAM's checker of OpenDRIVE wants numpy 1: it was run by hand (docs/export.md), this keeps what it found."""
    raw = (
        b'<OpenDRIVE><header revMajor="1" revMinor="4" name="" date="Thu Nov 26 13:42:55 2026" north="91.0"/>'
        b'<outline id="0" fillType="paint" outer="true" closed="true" laneType="none"><cornerLocal u="1" id="3" v="2"/>'
        b'</outline><road id="7" name="date"/></OpenDRIVE>'
    )
    assert storyboard.conform_to_version(raw) == (
        b'<OpenDRIVE><header revMajor="1" revMinor="4" name="" north="91.0"/>'
        b'<outline><cornerLocal u="1" v="2"/></outline><road id="7" name="date"/></OpenDRIVE>'
    )


def test_the_same_network_gives_the_same_map(recording: ScoredRecording, storyboard: ModuleType) -> None:
    xodr = storyboard.build_opendrive(recording.roads)
    header = ElementTree.fromstring(xodr).find("header")
    assert header is not None and "date" not in header.attrib
    for element, names in storyboard.NEWER_ATTRIBUTES.items():
        assert not any(
            set(one.attrib) & {name.decode() for name in names}
            for one in ElementTree.fromstring(xodr).iter(element.decode())
        )

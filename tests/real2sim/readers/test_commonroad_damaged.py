"""CommonRoad: damaged scenarios, a missing library and its remarks."""

import logging
import sys
import warnings
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.commonroad_samples import (
    BOX,
    CAR,
    LANE,
    MOVES,
    Write,
    format_lanelet,
    format_obstacle,
    format_parked,
    format_scenario,
    make_sign,
)
from testing.sampling import examples

from mdrive_sumo.core.errors import InputError
from real2sim.readers.commonroad import read_commonroad
from real2sim.readers.time_grid import TimeWindow, crop_recording


def test_remarks_of_the_library_become_notes(write: Write, caplog: pytest.LogCaptureFixture) -> None:
    """Nothing is warned of or logged, and both are as before afterwards."""
    path = write(format_lanelet(1, 0), format_obstacle(7), place="nowhere")
    logger = logging.getLogger("commonroad")
    before = logger.propagate, list(logger.handlers)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (note,) = read_commonroad(path).notes
    assert note.startswith("commonroad-io made 2 remarks, the first: ")
    assert not caplog.records
    assert (logger.propagate, logger.handlers) == before


# --- damaged files ---
def test_without_commonroad_io(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "commonroad.common.file_reader", None)
    with pytest.raises(
        InputError, match=r"expected commonroad-io to be installed, found none: pip install .*\[convert\]"
    ):
        read_commonroad(write(format_lanelet(1, 0), format_obstacle(7)))


BOMB = '<!DOCTYPE commonRoad [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><commonRoad>&b;</commonRoad>'


SHORT = LANE.replace("<point><x>0</x><y>1.75</y></point>", "")


POINT = "<leftBound><point><x>1</x><y>1</y></point></leftBound><rightBound><point><x>1</x><y>2</y></point></rightBound>"


DAMAGE: dict[str, tuple[str, str]] = {
    "not XML": ("track_id,frame_id", "expected well-formed XML"),
    "empty": ("", "expected well-formed XML"),
    "truncated": (format_scenario(LANE, CAR)[:-30], "expected well-formed XML"),
    "document type": (BOMB, "expected XML without a document type, found <!DOCTYPE commonRoad>"),
    "root": ("<osm/>", "expected the root <commonRoad>, found <osm>"),
    "version": (
        format_scenario(LANE, CAR, version="2016a"),
        "commonRoadVersion: expected 2018b or 2020a, found '2016a'",
    ),
    "no version": ("<commonRoad/>", "commonRoadVersion: expected 2018b or 2020a, found None"),
    "no clock": (format_scenario(LANE, CAR, dt="nan"), "timeStepSize: expected a finite number, found 'nan'"),
    "still clock": (format_scenario(LANE, CAR, dt="0"), "timeStepSize: expected a positive number, found '0'"),
    "no lanelets": (format_scenario(CAR), "expected at least one <lanelet>, found none"),
    "crosswalks only": (
        format_scenario(format_lanelet(1, 0, "<laneletType>crosswalk</laneletType>"), CAR),
        "expected at least one lanelet for vehicles, found crosswalks only",
    ),
    "one point": (
        format_scenario(f"<lanelet id='1'>{POINT}</lanelet>", CAR),
        "expected a valid CommonRoad scenario, found:",
    ),
    "one place": (
        format_scenario(
            f"<lanelet id='1'>{POINT.replace('</point>', '</point><point><x>1</x><y>1</y></point>')}</lanelet>", CAR
        ),
        "lanelet 1: expected at least two distinct points, found 1",
    ),
    "uneven bounds": (format_scenario(SHORT, CAR), "expected a valid CommonRoad scenario, found:"),
    "NaN bound": (
        format_scenario(LANE.replace("<x>50<", "<x>nan<"), CAR),
        "lanelet 1: x: expected a finite number, found 'nan'",
    ),
    "no obstacles": (format_scenario(LANE), "expected at least one dynamic obstacle with a trajectory, found none"),
    "parked only": (
        format_scenario(LANE, format_parked(8)),
        "expected at least one dynamic obstacle with a trajectory, found none",
    ),
    "NaN": (
        format_scenario(LANE, CAR.replace("<x>11<", "<x>nan<")),
        "dynamicObstacle 7: x: expected a finite number, found 'nan'",
    ),
    "no position": (
        format_scenario(LANE, CAR.replace("<position><point><x>11</x><y>0</y></point></position>", "")),
        "obstacle 7: expected <position> in every state, found one without",
    ),
    "no time": (
        format_scenario(LANE, CAR.replace("<exact>4</exact>", "")),
        "obstacle 7: time: expected one of exact, intervalStart, found none of them",
    ),
    "no number": (
        format_scenario(LANE, CAR.replace("<x>11<", "<x>east<")),
        "dynamicObstacle 7: x: expected a finite number, found 'east'",
    ),
    "flat": (
        format_scenario(LANE, CAR.replace("<width>1.8", "<width>0")),
        "obstacle 7: shape: expected a positive length and width, found 4.5 and 0",
    ),
    "no shape": (format_scenario(LANE, CAR.replace(BOX, "")), "expected a valid CommonRoad scenario, found: "),
    "no length": (
        format_scenario(LANE, CAR.replace("<length>4.5</length>", "")),
        "expected a valid CommonRoad scenario, found: an element is missing: 'NoneType' object",
    ),
    "no speed": (
        format_scenario(format_lanelet(1, 0, "<trafficSignRef ref='9'/>"), make_sign(9, "R2-1", "fast"), CAR),
        "trafficSign 9: additionalValue: expected a positive speed, found 'fast'",
    ),
    "no type": (
        format_scenario(LANE, CAR.replace("<type>car</type>", "")),
        "expected a valid CommonRoad scenario, found: ",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_scenarios(tmp_path: Path, name: str) -> None:
    text, words = DAMAGE[name]
    path = tmp_path / "scenario.xml"
    path.write_text(text)
    _refused(path, words)


@settings(max_examples=examples(37, 150), suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_a_scenario_with_some_element_damaged(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever is missing or no number: a recording or one sentence."""
    signs = make_sign(91, "206") + make_sign(93, "274", "8.5")
    lane = format_lanelet(1, 0, "<trafficSignRef ref='91'/><trafficSignRef ref='93'/>")
    root = ElementTree.fromstring(format_scenario(lane, signs, CAR, format_parked(8)))
    parents = [one for one in root.iter() if len(one)]
    parent = data.draw(st.sampled_from(parents))
    child = data.draw(st.sampled_from(list(parent)))
    if data.draw(st.booleans()):
        parent.remove(child)
    else:
        child.text = data.draw(st.sampled_from(["", "east", "nan", "-1"]))
    path = tmp_path / "scenario.xml"
    path.write_bytes(ElementTree.tostring(root))
    try:
        recording = read_commonroad(path)
    except InputError as error:
        assert str(error).startswith(str(path))
    else:
        assert recording.frame_count >= 1


def test_a_missing_file(tmp_path: Path) -> None:
    _refused(tmp_path / "scenario.xml", "cannot be read: No such file")


def _refused(path: Path, words: str, window: TimeWindow | None = None) -> None:
    with pytest.raises(InputError) as error:
        crop_recording(str(path), read_commonroad(path), window)
    assert words in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_window_without_tracks(write: Write) -> None:
    path = write(format_lanelet(1, 0), format_obstacle(7, MOVES.replace("<exact>6<", "<exact>9<")))
    _refused(path, "expected a window with at least one track, found none from 0.2 s to 0.4 s", window=(0.2, 0.4))

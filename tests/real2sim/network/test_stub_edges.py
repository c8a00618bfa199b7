"""Stubs at open ends of connectors: none lies on another lane."""

from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import drive, lane, lanes_map
from testing.network_samples import built
from testing.shared_material import SHARED_DATA

from mdrive_sumo.core.geometry import wrap_angles
from mdrive_sumo.roads import RoadMap
from real2sim.fidelity_targets import build_network_targets
from real2sim.hd_map import MapLane
from real2sim.readers.commonroad import read_commonroad

PEACH = SHARED_DATA / "real_logs/commonroad/USA_Peach-4_8_T-1.xml"
PHANTOM = "phantom"


def find_overlapped_stubs(roads: RoadMap) -> dict[str, str]:
    """Edges of up to 8 m that another lane covers in the opposite direction: every point of theirs is on it."""
    found: dict[str, str] = {}
    for stub in (one for one in roads.driving if not one.junction and one.centre.length <= 8.0):
        points = [(*stub.centre.at(s), stub.centre.yaw_at(s)) for s in np.linspace(0.2, stub.centre.length - 0.2, 5)]
        for other in roads.driving:
            feet = [(other.centre.project(x, y), yaw) for x, y, yaw in points]
            against = [
                abs(d) < 1.5 and 0 < s < other.centre.length and abs(wrap_angles(other.centre.yaw_at(s) - yaw)) > 2.0
                for (s, d), yaw in feet
            ]
            if other.id != stub.id and all(against):
                found[stub.id] = other.id
    return found


def junction_with_phantom(*extra: MapLane) -> tuple[MapLane, ...]:
    """A road south and a left-turn lane north that continues straight into the oncoming lane, as OpenStreetMap has it.

    A crossing road makes the phantom a connector.
    """
    return (
        lane("south", [(0, 100), (0, 20)], ("through",)),
        lane("through", [(0, 20), (0, -20)], ("south2",), junction=True),
        lane("south2", [(0, -20), (0, -100)]),
        lane("pocket", [(0.5, -60), (0.5, -21)], (PHANTOM, "turn")),
        lane(PHANTOM, [(0.5, -21), (0.4, 0), (0.0, 19)], junction=True),
        lane("turn", [(0.5, -21), (0.2, -8), (-8, -0.5), (-21, 0)], ("west",), junction=True),
        lane("west", [(-21, 0), (-100, 0)]),
        lane("east_in", [(-100, -5), (-21, -5)], ("cross",)),
        lane("cross", [(-21, -5), (21, -5)], ("east",), junction=True),
        lane("east", [(21, -5), (100, -5)]),
        *extra,
    )


def test_a_connector_that_ends_on_the_oncoming_lane_is_left_out_with_a_reason(tmp_path: Path) -> None:
    report, roads = built(tmp_path, lanes_map(*junction_with_phantom()))
    assert report.drop_reason_by_lane == {PHANTOM: "it leads nowhere but onto a lane of the opposite direction"}
    assert find_overlapped_stubs(roads) == {}
    assert [one.id for one in roads.driving if not one.junction and one.centre.length < 8] == []
    (turn,) = (one for one in roads.driving if one.edge == "epocket")
    assert len(turn.successors) == 1  # the turn is still there
    assert max(report.deviation.mean, report.deviation.back_mean) < 0.01


def test_a_lane_before_the_phantom_that_leads_nowhere_else_goes_as_well(tmp_path: Path) -> None:
    second = lane("second", [(0.5, 2), (0.0, 19)], junction=True)
    lanes = [one for one in junction_with_phantom() if one.id not in (PHANTOM, "turn")]
    first = lane(PHANTOM, [(0.5, -21), (0.5, 2)], ("second",), junction=True)
    report, roads = built(tmp_path, lanes_map(*lanes, first, second))
    assert set(report.drop_reason_by_lane) == {PHANTOM, "second"}
    assert find_overlapped_stubs(roads) == {}


def test_a_lane_that_is_left_out_in_part_is_listed_with_its_metres_and_not_measured_there(tmp_path: Path) -> None:
    """The phantom is one lane with the pocket before it: only what lies beyond the cut at its neighbour is removed."""
    lanes = [one for one in junction_with_phantom() if one.id not in ("pocket", PHANTOM, "turn")]
    long = lane(PHANTOM, [(0.5, -100), (0.5, -31), (0.5, -1), (0.0, 19)])
    beside = lane("beside", [(4, -100), (4, 7)], ())
    report, _ = built(tmp_path, lanes_map(*lanes, long, beside))
    assert report.lost_in_part == {PHANTOM}
    assert report.lost_m_by_lane.keys() == {PHANTOM}
    assert 10.0 < report.lost_m_by_lane[PHANTOM] < 60.0
    metres, _, why = report.drop_reason_by_lane[PHANTOM].partition(": ")
    assert metres == f"{report.lost_m_by_lane[PHANTOM]:.1f} of its 119.0 m"
    assert why == "it leads nowhere but onto a lane of the opposite direction"
    assert report.deviation.max < 0.5
    means = build_network_targets(report, 0)[0]
    assert means.met
    assert means.detail == f"{report.lost_m_by_lane[PHANTOM]:.1f} m of 1 lanes are left out of the network"


def test_a_connector_that_the_log_drives_on_stays(tmp_path: Path) -> None:
    """Whatever the map means by it: a way that is driven must not be interrupted."""
    lanes = [one for one in junction_with_phantom() if one.id not in ("south", "through")]
    oncoming = lane("oncoming", [(0.2, 21), (0.2, 14)], ())  # a short lane on the phantom's last metres
    ways = [drive(np.array([(0.5, -60.0), (0.5, -21.0), (0.4, 0.0), (0.0, 19.0)])) for _ in range(3)]
    report, roads = built(tmp_path, lanes_map(*lanes, oncoming), *ways)
    assert PHANTOM not in report.drop_reason_by_lane
    assert any(one.edge == f"e{PHANTOM}~1" for one in roads.driving)


@pytest.mark.parametrize("at_start", [True, False])
def test_connectors_with_one_open_end_share_a_stub(at_start: bool, tmp_path: Path) -> None:
    """The map's border cuts a junction off where its lanes part, or join."""
    ahead, turn = [(0, 0), (20, 0), (40, 0)], [(0, 0), (15, 0.8), (30, 12)]
    around = lane("around", [(30, -30), (25, 30)], ())  # crosses both
    far, north = lane("far", [(40, 0), (120, 0)]), lane("north", [(30, 12), (40, 80)])
    lanes = [lane("ahead", ahead, ("far",), junction=True), lane("turn", turn, ("north",), junction=True), far, north]
    if not at_start:
        exits = {"far": ("ahead",), "north": ("turn",)}
        lanes = [lane(one.id, one.centre[::-1], exits.get(one.id, ()), junction=one.junction) for one in lanes]
    _, roads = built(tmp_path, lanes_map(*lanes, around))
    stubs = [one for one in roads.driving if not one.junction and one.centre.length < 3.0 and "around" not in one.id]
    assert len(stubs) == 1
    linked = len(stubs[0].successors) if at_start else sum(stubs[0].id in one.successors for one in roads.driving)
    assert linked == 2


@pytest.mark.full
@pytest.mark.skipif(not PEACH.is_file(), reason="needs ../shared/data")
def test_the_real_map_with_phantom_connectors_has_no_overlapped_stub(tmp_path: Path) -> None:
    recording = read_commonroad(PEACH)
    report, roads = built(tmp_path, recording.map)
    assert set(report.drop_reason_by_lane) == {"43620", "43634"}
    assert find_overlapped_stubs(roads) == {}

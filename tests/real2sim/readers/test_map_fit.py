"""Logs on the map of another place."""

from dataclasses import replace

import pytest
from testing.small_log import recording, road, track

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import HdMap
from real2sim.readers.map_fit import check_on_map
from real2sim.recording import ObjectCategory, ObserverView, Recording


def place(x: float, y: float, share: float, map_: HdMap | None = None) -> Recording:
    """A log with so many of its vehicles moved by x, y [m]."""
    tracks = [track(str(k), 20.0, 0.0, 5.0) for k in range(100)]
    moved = [one.replace_columns(x=one.x + x, y=one.y + y) for one in tracks[: round(100 * share)]]
    views = (ObserverView("log", (*moved, *tracks[len(moved) :])),)
    return replace(recording(), views=views, map=map_ or road())


def test_a_log_belongs_to_its_map_if_half_of_its_vehicles_are_within_30_m_of_a_lane() -> None:
    check_on_map(place(0.0, -29.0, 1.0))
    check_on_map(place(5000.0, 0.0, 0.5))
    with pytest.raises(InputError, match=r"found 52% of the vehicles' points more than 30 m off \(median 48\d\d m\)"):
        check_on_map(place(5000.0, 0.0, 0.52))
    with pytest.raises(InputError, match="it is the map of another place"):
        check_on_map(place(0.0, -31.0, 1.0))


def test_pedestrians_may_be_far_from_every_lane_and_a_map_without_lanes_is_another_matter() -> None:
    away = track("w", 20.0, 900.0, 1.0, ObjectCategory.PEDESTRIAN)
    check_on_map(replace(recording(), views=(ObserverView("log", (away,)),)))
    check_on_map(place(5000.0, 0.0, 1.0, HdMap(lanes={})))

"""A vehicle whose place is taken departs later, where the log has it then."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.fit_crossing import DT_S, crossing, made, matches_of, seconds, track

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.fit import FittedTraffic, fit_traffic
from real2sim.pipeline.departures import ROUNDS, begin_at, fit_departures
from real2sim.recording import ObjectCategory, RecordedTrack
from real2sim.traffic_fidelity import TrafficFidelity, measure_traffic_fidelity


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    folder: Path = tmp_path_factory.mktemp("crossing")
    return crossing(folder)


@dataclass
class Conversion:
    """The steps of a conversion that departures repeat; remembers every call of `fit`."""

    roads: RoadMap
    scenario: Scenario
    tracks: tuple[RecordedTrack, ...]
    asked: list[dict[str, int]] = field(default_factory=list[dict[str, int]])

    def fit(self, departures: Mapping[str, int]) -> FittedTraffic:
        self.asked.append(dict(departures))
        driven = [begin_at(one, departures.get(one.id, 0)) for one in self.tracks]
        return fit_traffic(driven, matches_of(driven, self.roads), self.roads, ("cav",), "reactive", DT_S)

    def measure(self, fitted: FittedTraffic) -> TrafficFidelity:
        update = {"egos": fitted.egos, "background": fitted.background, "actors": fitted.actors}
        scenario = self.scenario.model_copy(update=update)
        return measure_traffic_fidelity(scenario, self.roads, self.tracks, fitted.names, DT_S)


def conversion(roads: RoadMap, *tracks: RecordedTrack) -> Conversion:
    scene = made(roads, *tracks)
    return Conversion(roads, scene.scenario, scene.tracks)


def test_a_log_in_which_all_depart_is_fitted_once(roads: RoadMap) -> None:
    steps = conversion(roads, track("a", 20.0 + 10.0 * seconds(), 0.0))
    _, closeness, notes = fit_departures(steps.fit, steps.measure, DT_S)
    assert (steps.asked, notes, closeness.departed_late) == ([{}], (), ())


@pytest.mark.slow
def test_a_vehicle_seen_right_before_another_departs_when_it_has_its_gap(roads: RoadMap) -> None:
    """First seen 6 m before the follower's bumper, slowly, with the follower closing in: no gap for full braking."""
    ahead = 54.0 + np.where(seconds() < 4.0, 2.0 * seconds(), 8.0 + 12.0 * (seconds() - 4.0))
    late = track("late", np.where(seconds() < 3.0, np.nan, ahead), 0.0)
    follower = track("follower", 46.0 - 26.0 + np.minimum(10.0 * seconds(), 35.0 + 3.0 * (seconds() - 3.5)), 0.0)
    steps = conversion(roads, follower, late)
    first = steps.measure(steps.fit({}))
    assert [name for name, _ in first.departed_late] == ["late"] or first.not_departed == ("late",)
    fitted, closeness, notes = fit_departures(steps.fit, steps.measure, DT_S)
    assert (closeness.not_departed, closeness.departed_late) == ((), ())
    (one,) = [vehicle for vehicle in fitted.background.vehicles if vehicle.id == "late"]
    assert one.depart_s > 3.0
    assert notes == (f"late departs {one.depart_s - 3.0:.1f} s after it is first seen: before, its place is not free",)
    worst = [error.worst for error in closeness.errors if error.worst is not None]
    assert max(worst) < 3.0
    assert 1 < len(steps.asked) <= ROUNDS + 3


# --- the rounds, without SUMO -------------------------------------------------------------------------------------


@dataclass
class Waiting:
    """Vehicles "a" (track 1) and "b" (track 2), first seen in frames 0 and 10; some departures take too long."""

    late_s: list[dict[str, float]]
    """By how much vehicles depart late in each round; infinity: not at all."""
    asked: list[dict[str, int]] = field(default_factory=list[dict[str, int]])

    def fit(self, departures: Mapping[str, int]) -> FittedTraffic:
        self.asked.append(dict(departures))
        first = {"1": 0, "2": 10, **departures}
        vehicles = [SimpleNamespace(id=name, depart_s=first[id_] * DT_S) for id_, name in (("1", "a"), ("2", "b"))]
        names = {"1": "a", "2": "b"}
        return SimpleNamespace(names=names, background=SimpleNamespace(vehicles=vehicles))  # pyright: ignore[reportReturnType]

    def measure(self, _: FittedTraffic) -> TrafficFidelity:
        late = self.late_s[min(len(self.asked), len(self.late_s)) - 1]
        return SimpleNamespace(  # pyright: ignore[reportReturnType]
            departed_late=tuple((name, delay) for name, delay in late.items() if np.isfinite(delay)),
            not_departed=tuple(name for name, delay in late.items() if np.isinf(delay)),
        )


def test_every_vehicle_departs_later_by_what_it_waited_and_delays_add_up() -> None:
    steps = Waiting([{"b": 0.6}, {"b": 0.5, "a": np.inf}, {}])
    _, _, notes = fit_departures(steps.fit, steps.measure, DT_S)
    assert steps.asked == [{}, {"2": 16}, {"2": 21, "1": 10}]
    assert notes == (
        "a departs 1.0 s after it is first seen: before, its place is not free",
        "b departs 1.1 s after it is first seen: before, its place is not free",
    )


def test_a_vehicle_that_never_gets_its_gap_is_left_as_it_is_after_some_rounds() -> None:
    steps = Waiting([{"a": np.inf}])
    _, closeness, notes = fit_departures(steps.fit, steps.measure, DT_S)
    assert [asked.get("1", 0) for asked in steps.asked] == [0, 10, 20, 30, 40]
    assert closeness.not_departed == ("a",)
    assert notes == ("a departs 4.0 s after it is first seen: before, its place is not free",)


@given(st.lists(st.booleans(), min_size=2, max_size=30), st.integers(0, 40))
def test_a_track_begun_later_is_the_same_from_then_on(seen: list[bool], first: int) -> None:
    valid = np.array(seen)
    table = np.where(valid[:, None], np.arange(5.0) + np.arange(len(seen))[:, None], np.nan)
    whole = RecordedTrack.from_table("a", ObjectCategory.CAR, table)
    cut = begin_at(whole, first)
    if valid[first:].sum() < 2:
        assert cut is whole
        return
    assert cut.valid_frames.tolist() == [frame for frame in whole.valid_frames.tolist() if frame >= first]
    for name in ("x", "y", "yaw", "length", "width"):
        assert np.isnan(getattr(cut, name)[~cut.valid]).all()
        assert np.array_equal(getattr(cut, name)[cut.valid], getattr(whole, name)[cut.valid], equal_nan=True)

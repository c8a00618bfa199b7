"""A vehicle whose place is taken departs later, where the log has it then."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from testing.fit_crossing import DT_S, crossing, made, matches_of, seconds, track

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.fit import FittedTraffic, fit_traffic
from real2sim.pipeline.departures import ROUNDS, begin_at, fit_departures
from real2sim.recording import RecordedTrack
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

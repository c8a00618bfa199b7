"""Departures that are blocked: the vehicle departs later, where the log has it then, instead of late where it was seen.

SUMO inserts a vehicle when its place is free, with a gap that full braking can keep. Drivers of a log are nearer, a bus
swings out of its lane in bends, and a place on the centre line may be taken by a vehicle that was beside it. Waiting
for the gap costs seconds that a vehicle does not regain, and with them the order at the next conflict.
"""

from collections.abc import Callable, Mapping

import numpy as np

from real2sim.fit import FittedTraffic
from real2sim.recording import RecordedTrack
from real2sim.traffic_fidelity import TrafficFidelity

STEP_S = 1.0
"""[s] A vehicle that did not depart at all is tried again this much later."""
ROUNDS = 4
"""A vehicle without a gap for 4 s departs when it finds one, or is listed as not departed."""

Fit = Callable[[Mapping[str, int]], FittedTraffic]
Measure = Callable[[FittedTraffic], TrafficFidelity]


def begin_at(track: RecordedTrack, frame: int) -> RecordedTrack:
    """Return the track without the frames before `frame`; as it is if fewer than two are left."""
    valid = track.valid & (np.arange(len(track.valid)) >= frame)
    return track if valid.sum() < 2 else track.restrict(valid)


def fit_departures(fit: Fit, measure: Measure, dt_s: float) -> tuple[FittedTraffic, TrafficFidelity, tuple[str, ...]]:
    """Fit and measure the traffic until every vehicle departs on time; return both, and a note for each that departs
    later than it is seen.

    `fit` takes the frames from which vehicles are driven, by track id.
    """
    departures: dict[str, int] = {}
    delays: dict[str, int] = {}
    fitted = fit(departures)
    closeness = measure(fitted)
    for _ in range(ROUNDS):
        waiting = {name: round(delay / dt_s) for name, delay in closeness.departed_late}
        waiting |= dict.fromkeys(closeness.not_departed, round(STEP_S / dt_s))
        if not waiting:
            break
        tracks = {name: id_ for id_, name in fitted.names.items()}
        departs = {vehicle.id: round(vehicle.depart_s / dt_s) for vehicle in fitted.background.vehicles}
        for name, frames in waiting.items():
            departures[tracks[name]] = departs[name] + frames
            delays[name] = delays.get(name, 0) + frames
        fitted = fit(departures)
        closeness = measure(fitted)
    notes = (f"{name} departs {frames * dt_s:.1f} s after it is first seen: before, its place is not free"
             for name, frames in sorted(delays.items()))  # fmt: skip
    return fitted, closeness, tuple(notes)

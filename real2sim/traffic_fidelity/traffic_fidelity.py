"""Distance of reactive traffic from the log while the CAVs repeat what they did in the log.

The scenario runs in SUMO with the CAVs and all scripted actors placed on their logged poses at every tick. The
remaining deviation is that of SUMO's traffic: position errors over time, order at conflict points, contacts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.fit.background_vehicle import median_size
from real2sim.recording import RecordedTrack
from real2sim.tracks.track_contacts import find_contacts
from real2sim.traffic_fidelity.log_simulation import SimulatedTraffic, simulate_log
from real2sim.traffic_fidelity.passing_order import find_conflict_points, is_order_kept

AFTER_S = (1.0, 2.0, 3.0, 5.0, 8.0)
"""[s] Times after its departure at which a vehicle's position is compared."""
GONE_M = 100.0
"""[m] Error of a vehicle that is absent from the simulation while the log has it."""
MEDIAN_5S_M, ORDER_SHARE = 3.0, 0.9
"""Targets of issue C."""
LATE_S = 0.3
"""[s] A vehicle appears in the frame after its insertion; what is later by more than that had to wait."""
SLACK_M = 0.1
"""[m] Each box side is moved inwards by this before two boxes count as touching, as in `quality.COLLISION_SLACK_M`."""


class PositionErrors(BaseModel):
    """Position errors of all vehicles that the log still has at a time after their departure."""

    model_config = ConfigDict(frozen=True)

    after_s: float
    vehicles: int
    median: float | None
    """[m]; None if no vehicle is in the log for that long."""
    lower: float | None
    upper: float | None
    """Lower and upper quartile [m] of the errors."""
    worst: float | None


class TrafficFidelity(BaseModel):
    """Figures for quality.json. A vehicle that is absent while the log has it counts with an error of 100 m."""

    model_config = ConfigDict(frozen=True)

    mode: str
    vehicles: int
    """Number of background vehicles."""
    errors: tuple[PositionErrors, ...]
    median_at_5s: float | None
    """[m]; None if no vehicle is in the log for 5 s."""
    order_pairs: int
    """Pairs of vehicles whose paths cross or merge, at least one of them background."""
    order_kept: int
    order_share: float | None
    order_changed: tuple[tuple[str, str], ...]
    """First and second vehicle to pass in the log; in the simulation the order is different, or neither passed."""
    not_departed: tuple[str, ...]
    departed_late: tuple[tuple[str, float], ...] = ()
    """Vehicles that departed later than in the log by more than `LATE_S`, because their place was taken, and by how
    much [s]."""
    left_early: tuple[str, ...]
    """Vehicles that left the simulation before they leave the log."""
    contacts: tuple[tuple[str, str, int], ...]
    """Background vehicles whose boxes overlap in the simulation but not in the log, with the number of frames."""


@dataclass(frozen=True)
class _VehicleTracks:
    """A background vehicle in log and simulation: positions (T, 2) [m] in the log's frames, NaN where it is absent."""

    name: str
    log: Float
    simulated: Float


def measure_traffic_fidelity(
    scenario: Scenario,
    roads: RoadMap,
    tracks: Sequence[RecordedTrack],
    names: Mapping[str, str],
    dt_s: float,
) -> TrafficFidelity:
    """Run the scenario in SUMO and compare it with its log. `names`: track id -> id in the scenario
    (`FittedTraffic.names`).

    Needs the process's only SUMO simulation. Raises WorldError or InputError as `SumoWorld` does.
    """
    by_name = {names[track.id]: track for track in tracks}
    run = simulate_log(scenario, roads, by_name, dt_s)
    vehicles = [_pair_tracks(by_name[scheduled.id], scheduled, run, dt_s) for scheduled in scenario.background.vehicles]
    moving = {ego.id: by_name[ego.id].xy for ego in scenario.egos} | {vehicle.name: vehicle.log for vehicle in vehicles}
    placed = {ego.id: by_name[ego.id].xy for ego in scenario.egos} | {
        vehicle.name: vehicle.simulated for vehicle in vehicles
    }
    background = {vehicle.name for vehicle in vehicles}
    pairs = [point for point in find_conflict_points(moving) if background & {point.first, point.second}]
    changed = tuple((point.first, point.second) for point in pairs if not is_order_kept(point, moving, placed))
    errors = tuple(_summarize_errors(vehicles, after, dt_s) for after in AFTER_S)
    there = [vehicle for vehicle in vehicles if np.isfinite(vehicle.simulated[:, 0]).any()]
    return TrafficFidelity(
        mode=scenario.background.mode,
        vehicles=len(vehicles),
        errors=errors,
        median_at_5s=next(error.median for error in errors if error.after_s == 5.0),
        order_pairs=len(pairs),
        order_kept=len(pairs) - len(changed),
        order_share=1 - len(changed) / len(pairs) if pairs else None,
        order_changed=changed,
        not_departed=tuple(vehicle.name for vehicle in vehicles if vehicle not in there),
        departed_late=tuple(
            (vehicle.name, delay) for vehicle in there if (delay := _compute_delay(vehicle, dt_s)) > LATE_S
        ),
        left_early=tuple(vehicle.name for vehicle in there if _has_left_early(vehicle, dt_s)),
        contacts=_find_new_contacts(vehicles, by_name, run),
    )


def _pair_tracks(
    track: RecordedTrack, vehicle: BackgroundVehicle, run: SimulatedTraffic, dt_s: float
) -> _VehicleTracks:
    """Pair log and simulation of one vehicle in the frames of its schedule; outside them the track is off the map."""
    times = np.arange(len(track.valid)) * dt_s
    ends = vehicle.schedule.progress[-1][0] if vehicle.schedule else times[-1]
    there = (times > vehicle.depart_s - dt_s / 2) & (times < ends + dt_s / 2)
    return _VehicleTracks(vehicle.id, np.where(there[:, None], track.xy, np.nan), run.xy(vehicle.id, len(times)))


def _summarize_errors(vehicles: Sequence[_VehicleTracks], after_s: float, dt_s: float) -> PositionErrors:
    errors = [error for vehicle in vehicles if (error := _compute_error(vehicle, after_s, dt_s)) is not None]
    if not errors:
        return PositionErrors(after_s=after_s, vehicles=0, median=None, lower=None, upper=None, worst=None)
    lower, median, upper, worst = (round(float(q), 3) for q in np.percentile(errors, (25, 50, 75, 100)))
    return PositionErrors(after_s=after_s, vehicles=len(errors), median=median, lower=lower, upper=upper, worst=worst)


def _compute_error(vehicle: _VehicleTracks, after_s: float, dt_s: float) -> float | None:
    """Return the distance [m] between log and simulation `after_s` after the vehicle's first frame; None if the log has
    ended."""
    frame = int(np.flatnonzero(np.isfinite(vehicle.log[:, 0]))[0]) + round(after_s / dt_s)
    if frame >= len(vehicle.log) or np.isnan(vehicle.log[frame, 0]):
        return None
    apart = float(np.hypot(*(vehicle.simulated[frame] - vehicle.log[frame])))
    return apart if np.isfinite(apart) else GONE_M


def _has_left_early(vehicle: _VehicleTracks, dt_s: float) -> bool:
    """Return whether the vehicle disappears more than half a second before it leaves the log."""
    last_seen, last_there = (int(np.flatnonzero(np.isfinite(xy[:, 0]))[-1]) for xy in (vehicle.log, vehicle.simulated))
    return last_there < last_seen - round(0.5 / dt_s)


def _compute_delay(vehicle: _VehicleTracks, dt_s: float) -> float:
    """Return how much later [s] than in the log the vehicle appears."""
    first_seen, first_there = (int(np.flatnonzero(np.isfinite(xy[:, 0]))[0]) for xy in (vehicle.log, vehicle.simulated))
    return round((first_there - first_seen) * dt_s, 3)


def _find_new_contacts(
    vehicles: Sequence[_VehicleTracks], tracks: Mapping[str, RecordedTrack], run: SimulatedTraffic
) -> tuple[tuple[str, str, int], ...]:
    logged = [tracks[vehicle.name] for vehicle in vehicles]
    placed = [
        replace_poses(tracks[vehicle.name], run.poses[vehicle.name])
        for vehicle in vehicles
        if vehicle.name in run.poses
    ]
    if len(placed) < 2:
        return ()
    in_log = {frozenset((logged[i].id, logged[j].id)) for i, j, _ in find_contacts(logged, SLACK_M).collisions}
    simulated = [(placed[i].id, placed[j].id, frames) for i, j, frames in find_contacts(placed, SLACK_M).collisions]
    names = {tracks[vehicle.name].id: vehicle.name for vehicle in vehicles}
    return tuple((names[a], names[b], frames) for a, b, frames in simulated if frozenset((a, b)) not in in_log)


def replace_poses(track: RecordedTrack, poses: Float) -> RecordedTrack:
    """Return the track with the poses of the simulation."""
    valid = np.isfinite(poses[:, 0])
    length, width = median_size(track)
    full = np.where(valid, 1.0, np.nan)
    return track.replace_columns(
        valid=valid, x=poses[:, 0], y=poses[:, 1], yaw=poses[:, 2], length=length * full, width=width * full
    )

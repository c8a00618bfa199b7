"""Begin logged traffic later in its log: schedules, replayed poses and logs of background vehicles."""

from collections.abc import Iterator, Sequence

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion

LEAST_LEFT_S = 0.2
"""Every log keeps at least this much [s]: two poses, and more than the tick that they are interpolated to."""
HALVINGS = 6
"""Number of times that a trim which does not fit is halved before it is given up."""


def find_log_trim(scenario: Scenario, wanted_s: float) -> float:
    """Return the trim [s] nearest below `wanted_s` at which every log goes on and no lane change is cut off.

    It is `wanted_s` halved as often as needed, and 0 for a scenario without logs.
    """
    logs = [*_iterate_times(scenario)]
    for halvings in range(HALVINGS if logs else 0):
        trim_s = round(wanted_s / (1 << halvings), 3)
        if all(last - trim_s >= LEAST_LEFT_S for _, last in logs) and not _cuts_lane_change(scenario, trim_s):
            return trim_s
    return 0.0


def _iterate_times(scenario: Scenario) -> Iterator[tuple[float, float]]:
    """Yield the first and last time [s] of every log."""
    for actor in scenario.actors:
        if isinstance(actor.motion, ReplayMotion) and actor.trigger is None:
            yield actor.motion.poses[0][0], actor.motion.poses[-1][0]
    for vehicle in scenario.background.vehicles:
        if vehicle.schedule is not None:
            yield vehicle.schedule.progress[0][0], vehicle.schedule.progress[-1][0]
        if vehicle.log:
            yield vehicle.log[0][0], vehicle.log[-1][0]


def _cuts_lane_change(scenario: Scenario, trim_s: float) -> bool:
    """Return whether a vehicle would depart behind the place of one of its lane changes."""
    schedules = [one.schedule for one in scenario.background.vehicles if one.schedule and one.schedule.lanes]
    return any(
        trim_rows(one.progress, trim_s)[0][1] > one.progress[0][1]
        and trim_rows(one.progress, trim_s)[0][1] >= one.lanes[0][0]
        for one in schedules
    )


def trim_rows(rows: Sequence[tuple[float, ...]], trim_s: float) -> tuple[tuple[float, ...], ...]:
    """Return rows (time [s], values ...) that begin `trim_s` later in the log; a row before 0 s becomes one at 0 s.

    The values of that row are interpolated linearly. The fourth is an angle [rad], which takes the shorter way.
    """
    moved: list[tuple[float, ...]] = [(round(row[0] - trim_s, 3), *row[1:]) for row in rows]
    first = next((i for i, row in enumerate(moved) if row[0] >= 0.0), len(moved) - 1)
    if first and moved[first][0] > 0.0:
        before, after = moved[first - 1], moved[first]
        share = -before[0] / (after[0] - before[0])
        steps = [b - a for a, b in zip(before, after, strict=True)]
        steps[3:] = map(wrap_angle, steps[3:])
        first -= 1
        moved[first] = (0.0, *(round(a + share * step, 4) for a, step in zip(before[1:], steps[1:], strict=True)))
    return tuple(moved[first:])


def trim_actor(actor: Actor, trim_s: float) -> Actor:
    """Return an actor whose replay begins later in the log; one that a trigger sets off stays as it is."""
    if not isinstance(actor.motion, ReplayMotion) or actor.trigger is not None or not trim_s:
        return actor
    return actor.model_copy(
        update={"motion": actor.motion.model_copy(update={"poses": trim_rows(actor.motion.poses, trim_s)})}
    )


def trim_vehicle(vehicle: BackgroundVehicle, trim_s: float) -> BackgroundVehicle:
    """Return a background vehicle whose schedule and log begin later."""
    if not trim_s or not (vehicle.schedule or vehicle.log):
        return vehicle
    update: dict[str, object] = {"depart_s": round(max(vehicle.depart_s - trim_s, 0.0), 3)}
    if vehicle.log:
        update["log"] = trim_rows(vehicle.log, trim_s)
    if vehicle.schedule is not None:
        progress = trim_rows(vehicle.schedule.progress, trim_s)
        update["schedule"] = vehicle.schedule.model_copy(update={"progress": progress})
        if vehicle.schedule.progress[0][0] < trim_s:
            (t0, s0), (t1, s1) = progress[:2]
            update["depart_speed"] = round(min((s1 - s0) / (t1 - t0), 60.0), 3)
    return vehicle.model_copy(update=update)

"""The world that a seed draws: a scenario with jittered starts, triggers, scripted actors and drivers.

Seed 0 is the scenario exactly as written. Every other seed gives another one within `VariationBounds`. All draws depend
on the seed, the id of the scenario and the id of the road user only, so the same seed gives the same world whatever
else runs. Logged traffic begins later in its log.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    GapTrigger,
    LaneMotion,
    PathMotion,
    PositionTrigger,
    ReplayMotion,
    TimeTrigger,
    Trigger,
)
from mdrive_sumo.scenario.start_variation import StartBounds, vary_starts
from mdrive_sumo.scenario.suite import Suite


@dataclass(frozen=True, slots=True)
class VariationBounds:
    """How far a seed may take a scenario from what is written. Assumptions, each with its reason."""

    start: StartBounds = field(default_factory=StartBounds)
    """Bounds of the starts of CAVs."""
    log_trim_s: float = 0.5
    """Logged traffic begins up to this much later in its log [s]: the interval in which `find_conflicts` still sees the
    same order of vehicles. All of a scenario's log by the same time, because logged vehicles do not yield to each
    other."""
    trigger_share: float = 0.15
    """Share of the distance or radius of a trigger: 15 % of the usual 8 to 25 m is up to one car's length."""
    trigger_time_s: float = 0.5
    """[s] of a trigger at a time: a driver's reaction time."""
    actor_speed_share: float = 0.1
    """Of the speed of a scripted actor: the spread of walking and free driving speeds is about that (SUMO draws
    speed factors with a deviation of 0.1)."""
    driver_share: float = 0.1
    """Share of headway, gap, acceleration and deceleration of SUMO's drivers, as for speeds."""
    imperfection: float = 0.1
    """Change of `sigma` up or down; it stays within 0 and 1."""
    departure_s: float = 0.5
    """[s] of the departure of vehicles without schedule, never below 0; those that depart at 0 s stay in frame 0."""


BOUNDS = VariationBounds()


def load_varied_scenario(suite: Suite, scenario: Scenario, seed: int) -> tuple[Scenario, RoadMap]:
    """Return a scenario of a suite as a seed draws it, and its network. Raises InputError.

    Whatever drives, scores, checks or shows an episode takes its scenario from here, with the seed of the episode.
    """
    roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
    return vary_scenario(scenario, roads, seed), roads


def vary_scenario(scenario: Scenario, roads: RoadMap, seed: int) -> Scenario:
    """Return the scenario that a seed draws, without absent road users; for seed 0 the scenario as written.

    `scenario` may be one that another seed drew: it is the one as written that is varied. Ids, routes' goals, props,
    lateral positions, the weather, and the time limit stay as written.
    """
    written = scenario.as_written
    if seed == 0:
        return _leave_out(written)
    log_trim_s = find_log_trim(written, BOUNDS.log_trim_s * _draw(seed, written, "log")[0])
    actors = tuple(_vary_actor(trim_actor(one, log_trim_s), written, seed) for one in written.actors)
    vehicles = tuple(_vary_vehicle(trim_vehicle(one, log_trim_s), written, seed) for one in written.background.vehicles)
    background = written.background.model_copy(update={"vehicles": vehicles})
    moved = written.derive(actors=actors, background=background)
    return _leave_out(moved.derive(egos=vary_starts(moved, roads, seed, BOUNDS.start, log_trim_s)))


def _leave_out(drawn: Scenario) -> Scenario:
    """Return a drawn scenario without its absent road users, which starts of CAVs and the log have minded."""
    if not drawn.absent:
        return drawn
    present = tuple(one for one in drawn.background.vehicles if one.id not in drawn.absent)
    return drawn.derive(
        actors=tuple(actor for actor in drawn.actors if actor.id not in drawn.absent),
        background=drawn.background.model_copy(update={"vehicles": present}),
        absent=(),
    )


def _draw(seed: int, scenario: Scenario, *name: str) -> tuple[float, ...]:
    """Return numbers in [0, 1) for a part of a scenario."""
    return draw_uniforms(seed, "variation", scenario.id, *name)


def _spread(uniform: float, share: float) -> float:
    """Return a factor in [1 - share, 1 + share)."""
    return 1.0 + share * (2.0 * uniform - 1.0)


def _vary_actor(actor: Actor, scenario: Scenario, seed: int) -> Actor:
    """Return an actor with another trigger and another speed. Its place, size and way stay as written."""
    drawn = _draw(seed, scenario, "actor", actor.id)
    update: dict[str, Any] = {}
    if actor.trigger is not None:
        update["trigger"] = _vary_trigger(actor.trigger, drawn[0])
    if isinstance(actor.motion, PathMotion | LaneMotion):
        factor = _spread(drawn[1], BOUNDS.actor_speed_share)
        speeds = {key: round(getattr(actor.motion, key) * factor, 3) for key in ("speed", "start_speed")}
        update["motion"] = actor.motion.model_copy(update={key: min(speed, 60.0) for key, speed in speeds.items()})
    return actor.model_copy(update=update) if update else actor


def _vary_trigger(trigger: Trigger, uniform: float) -> Trigger:
    factor = _spread(uniform, BOUNDS.trigger_share)
    match trigger:
        case DistanceTrigger():
            update = {"distance_m": min(max(round(trigger.distance_m * factor, 3), 1.0), 50.0)}
        case PositionTrigger():
            update = {"radius_m": min(round(trigger.radius_m * factor, 3), 50.0)}
        case TimeTrigger():
            update = {"at_s": round(max(trigger.at_s + BOUNDS.trigger_time_s * (2.0 * uniform - 1.0), 0.0), 3)}
        case GapTrigger():
            update = {"after_s": round(max(trigger.after_s + BOUNDS.trigger_time_s * (2.0 * uniform - 1.0), 0.0), 3)}
    return trigger.model_copy(update=update)


def _vary_vehicle(vehicle: BackgroundVehicle, scenario: Scenario, seed: int) -> BackgroundVehicle:
    """Return a background vehicle with another driver and, if it has no log and departs later, another departure."""
    drawn = _draw(seed, scenario, "vehicle", vehicle.id)
    update: dict[str, Any] = {"driving": vehicle.driving.model_copy(update=_vary_driver(vehicle.driving, drawn))}
    if vehicle.schedule is None and not vehicle.log and vehicle.depart_s > 0.0:
        departure = vehicle.depart_s + BOUNDS.departure_s * (2.0 * drawn[5] - 1.0)
        update["depart_s"] = round(min(max(departure, 0.0), 3600.0), 3)
    return vehicle.model_copy(update=update)


def _vary_driver(driving: CarFollowing, drawn: tuple[float, ...]) -> Mapping[str, float]:
    """Return changed parameters of a driver, within the limits of the scenario file."""
    limits = {"tau_s": 10.0, "min_gap_m": 20.0, "accel": 20.0, "decel": 20.0}
    changed = {
        key: min(round(getattr(driving, key) * _spread(uniform, BOUNDS.driver_share), 3), limit)
        for (key, limit), uniform in zip(limits.items(), drawn[:4], strict=True)
    }
    sigma = driving.sigma + BOUNDS.imperfection * (2.0 * drawn[4] - 1.0)
    return {**changed, "sigma": round(min(max(sigma, 0.0), 1.0), 3)}


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

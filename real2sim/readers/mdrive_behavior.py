"""Convert behaviours of MDrive's actors to triggers and actions (protocol 3.4)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scripted_actor import Action, DistanceTrigger, HardBrake, LaneChange, StartMotion
from real2sim.readers.mdrive_manifest import BEHAVIOR, ActionEntry, BehaviorEntry, TriggerEntry, read_behaviors

DEFAULT_DISTANCE_M = 8.0
DISTANCE_LIMITS_M = (1.0, 50.0)
"""Trigger distances are clamped to these."""


@dataclass(frozen=True, slots=True)
class ActorScript:
    """Trigger and action of an actor."""

    trigger: DistanceTrigger
    action: Action


@dataclass(frozen=True, slots=True)
class ActorScripts:
    """Scripts by actor name, with notes on what was skipped or changed."""

    by_actor: Mapping[str, ActorScript]
    notes: tuple[str, ...]


def read_scripts(folder: Path, route_id: str, actors: Collection[str], vehicles: Mapping[str, str]) -> ActorScripts:
    """Read the behaviours of a scenario; raise InputError.

    Only those of route `route_id` count. `actors` are the names in the manifest, `vehicles` maps the names of CAVs
    (`Vehicle 1` is ego 0) to their ids.
    """
    of: dict[str, ActorScript] = {}
    notes: list[str] = []
    for number, entry in enumerate(read_behaviors(folder)):
        where = f"{folder / BEHAVIOR}: behavior {number}"
        if entry.route_id not in (None, route_id):
            notes.append(f"behaviour {number} of {entry.actor_name} is of route {entry.route_id}: skipped")
            continue
        if entry.actor_name not in actors:
            known = ", ".join(actors) or "none"
            raise InputError(
                f"{where}: actor_name: expected an actor of the manifest ({known}), found {entry.actor_name!r}"
            )
        if entry.trigger is None or entry.actor_name in of:
            why = "without a trigger" if entry.trigger is None else "a second one"
            notes.append(f"behaviour {number} of {entry.actor_name}: {why}, skipped")
            continue
        of[entry.actor_name] = _build_script(where, entry, entry.trigger, vehicles)
        notes += _note_clamping(entry)
    return ActorScripts(of, tuple(notes))


def map_vehicle_names(egos: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return names of CAVs -> ids, from (id, name in the manifest): `Vehicle k` is ego k - 1 whatever its name."""
    return {name: id_ for id_, name in egos if name} | {f"Vehicle {int(id_) + 1}": id_ for id_, _ in egos}


def _build_script(where: str, entry: BehaviorEntry, trigger: TriggerEntry, vehicles: Mapping[str, str]) -> ActorScript:
    distance = DEFAULT_DISTANCE_M if trigger.distance_m is None else trigger.distance_m
    return ActorScript(
        DistanceTrigger(
            vehicle=_find_vehicle(f"{where}: trigger: vehicle", trigger.vehicle, vehicles),
            distance_m=min(max(distance, DISTANCE_LIMITS_M[0]), DISTANCE_LIMITS_M[1]),
        ),
        _build_action(where, entry.action or ActionEntry(), vehicles),
    )


def _build_action(where: str, entry: ActionEntry, vehicles: Mapping[str, str]) -> Action:
    driven = 0.0 if entry.min_drive_distance_m is None else entry.min_drive_distance_m
    if entry.type == "hard_brake":
        return HardBrake(
            hold_s=HardBrake().hold_s if entry.brake_hold_s is None else entry.brake_hold_s,
            resume_speed=entry.resume_speed_mps,
            pacing=entry.pacing is not False,
            least_driven_m=driven,
        )
    if entry.type == "lane_change":
        target = entry.target_vehicle
        return LaneChange(
            direction=entry.direction,
            target_vehicle=target and _find_vehicle(f"{where}: action: target_vehicle", target, vehicles),
            pacing=entry.pacing is not False,
            least_driven_m=driven,
        )
    return StartMotion()


def _find_vehicle(where: str, name: str, vehicles: Mapping[str, str]) -> str:
    if name not in vehicles:
        raise InputError(f"{where}: expected one of {', '.join(vehicles)}, found {name!r}")
    return vehicles[name]


def _note_clamping(entry: BehaviorEntry) -> list[str]:
    distance = None if entry.trigger is None else entry.trigger.distance_m
    if distance is None or DISTANCE_LIMITS_M[0] <= distance <= DISTANCE_LIMITS_M[1]:
        return []
    return [f"trigger distance of {entry.actor_name}: {distance:g} m, clamped to [1, 50] m"]

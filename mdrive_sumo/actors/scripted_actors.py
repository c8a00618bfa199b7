"""The scripted actors of one episode, advanced tick by tick."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from mdrive_sumo.actors.actor_surroundings import CAR_SIZE, STATIC
from mdrive_sumo.actors.collision_avoidance import compute_speed_limits
from mdrive_sumo.actors.motion_path import MotionPath, build_lane_change_path, build_motion_path
from mdrive_sumo.actors.movers import advance_movers, build_movers, place_movers, set_paths
from mdrive_sumo.actors.path_tables import Rows
from mdrive_sumo.actors.trigger_script import (
    ActorPosition,
    ScriptPhase,
    advance_script,
    build_script_state,
    compute_target_speed,
    find_initial_speed,
)
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, box_corners, boxes_overlap, wrap_angle
from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors, EgoState, Frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import (
    KIND_BY_NAME,
    Actor,
    LaneChange,
    LaneMotion,
    PathMotion,
)


class ActorMode(StrEnum):
    """`default`: scripted actors react to others, on a global clock. `original`: as in MDrive's code (protocol 3.5)."""

    DEFAULT = "default"
    ORIGINAL = "original"


class ScriptedActors:
    """Moves the scripted actors. `original`: none avoids collisions, and all stop when the first CAV ends."""

    def __init__(self, scenario: Scenario, roads: RoadMap, mode: ActorMode = ActorMode.DEFAULT) -> None:
        """Raises InputError for lanes that do not connect."""
        actors = sorted(scenario.actors, key=lambda actor: actor.id)
        paths = [(i, path) for i, actor in enumerate(actors) if (path := build_motion_path(actor, roads)) is not None]
        self._roads, self._mode, self._leader = roads, mode, scenario.egos[0].id
        self._actors: list[Actor] = [actors[i] for i, _ in paths]
        self._paths: list[MotionPath] = [path for _, path in paths]
        self._index_by_id = {actor.id: STATIC for actor in actors} | {
            actor.id: i for i, actor in enumerate(self._actors)
        }
        self._states = {
            i: build_script_state(actor) for i, actor in enumerate(self._actors) if actor.trigger is not None
        }
        self._held_until: dict[int, int] = {}
        """Index of a mover -> tick until which it stands because it was struck."""
        self._movers = build_movers(self._actors, avoid_collisions=mode is ActorMode.DEFAULT)
        self._knots = set_paths(self._movers, self._paths)
        self._set_initial_states(scenario)
        self._assembler = ActorAssembler(actors, [i for i, _ in paths])
        self._frozen = False
        self.present: Actors = self._assembler.assemble(self._movers)
        """The actors in the last frame; before the first `advance`, in frame 0."""

    def _set_initial_states(self, scenario: Scenario) -> None:
        starts = {ego.id: (ego.start.x, ego.start.y) for ego in scenario.egos}
        movers, is_timed = self._movers, self._movers["is_timed"] != 0
        is_triggered = np.array([actor.trigger is not None for actor in self._actors], np.bool_)
        # A replay without a trigger runs on the scenario's clock.
        movers["progress"] = np.where(is_timed & ~is_triggered, 0.0, movers["begin"])
        self._movers = movers = place_movers(movers, self._knots)
        movers["speed"] = [find_initial_speed(actor, starts) for actor in self._actors]
        movers["speed"] = np.where(is_timed, np.where(is_triggered, 0.0, movers["slope"]), movers["speed"])
        movers["script_speed"] = [_find_cruise_speed(actor) for actor in self._actors]
        movers["clock_rate"] = 1.0

    def advance(self, frame: Frame, struck: Collection[str]) -> Actors:
        """Return the scripted actors one tick after `frame`, whose CAVs are those that have not ended.

        `struck`: ids of actors that a CAV touches in that frame; they stand for 2 s.
        """
        if not self._actors or self._frozen:
            return self.present
        if self._mode is ActorMode.ORIGINAL and self._leader not in frame.egos:
            self._frozen = True
            self.present = replace(self.present, speed=np.zeros(len(self.present)))
            return self.present
        self._advance_scripts(frame)
        self._hold(struck, frame.tick)
        egos = tuple(frame.egos.values())
        limits = compute_speed_limits(self._movers, self._knots, frame.tick, egos, frame.actors, self._index_by_id)
        self._movers = advance_movers(self._movers, limits)
        self._delay_blocked_entries(egos)
        self._movers = place_movers(self._movers, self._knots)
        self.present = self._assembler.assemble(self._movers)
        return self.present

    def _advance_scripts(self, frame: Frame) -> None:
        """Advance the scripts of triggered actors, which set their speeds."""
        for i, state in self._states.items():
            actor, mover = self._actors[i], self._movers[i]
            position = ActorPosition(float(mover["x"]), float(mover["y"]), float(mover["speed"]))
            after = self._states[i] = advance_script(state, actor, position, frame)
            if after.phase is ScriptPhase.AFTER and state.phase is ScriptPhase.BEFORE:
                self._start_lane_change(i, frame)
            mover = self._movers[i]
            mover["script_speed"] = compute_target_speed(after, actor, position, frame)
            mover["is_braking"] = after.phase is ScriptPhase.BRAKING

    def _start_lane_change(self, i: int, frame: Frame) -> None:
        actor, path, mover = self._actors[i], self._paths[i], self._movers[i]
        if not isinstance(actor.action, LaneChange):
            return
        pose = (float(mover["x"]), float(mover["y"]), float(mover["yaw"]))
        offset = compute_lane_change_offset(actor, path, pose, frame, self._roads)
        if not offset:
            return
        self._paths[i], mover["progress"] = build_lane_change_path(path, float(mover["s"]), offset, actor)
        self._knots = set_paths(self._movers, self._paths)
        self._movers = place_movers(self._movers, self._knots)

    def _hold(self, struck: Collection[str], tick: int) -> None:
        """Let those movers stand that are struck, or not yet triggered."""
        self._held_until |= {self._index_by_id.get(name, STATIC): tick + STRUCK_HOLD_TICKS for name in struck}
        self._held_until = {i: until for i, until in self._held_until.items() if i >= 0 and tick < until}
        waiting = [i for i, state in self._states.items() if state.phase is ScriptPhase.WAITING]
        self._movers["is_stopped"] = 0
        self._movers["is_stopped"][[*waiting, *self._held_until]] = 1

    def _delay_blocked_entries(self, egos: Sequence[EgoState]) -> None:
        """Delay the entry of replays that would appear inside a CAV, unless they do not avoid collisions."""
        if self._mode is ActorMode.ORIGINAL or not egos or not self._movers["is_entering"].any():
            return
        ego_boxes = np.stack([box_corners(ego.x, ego.y, ego.yaw, *CAR_SIZE) for ego in egos])
        for i in np.flatnonzero(self._movers["is_entering"]).tolist():
            actor, path = self._actors[i], self._paths[i]
            box = box_corners(path.x[0], path.y[0], path.yaw[0], actor.length, actor.width)
            if actor.avoid_collision and boxes_overlap(box, ego_boxes).any():
                self._movers["progress"][i] -= DT


def _find_cruise_speed(actor: Actor) -> float:
    """Return the speed [m/s] without a script; infinite for a replay, which follows its log."""
    return actor.motion.speed if isinstance(actor.motion, PathMotion | LaneMotion) else math.inf


class ActorAssembler:
    """Merges moving and static scripted actors; caches the constant columns until the set of present actors changes."""

    def __init__(self, actors: Sequence[Actor], movers: Sequence[int]) -> None:
        """`actors`: all scripted actors, sorted by id; `movers`: indices of those that move."""
        self._rows = np.array(movers, dtype=np.int64)
        starts = [(actor.start.x, actor.start.y, actor.start.yaw, 0.0) for actor in actors]
        self._all = np.array(starts, dtype=np.float64).reshape(-1, 4).T
        self._ids = tuple(actor.id for actor in actors)
        self._kind = np.array([KIND_BY_NAME[actor.kind] for actor in actors], dtype=np.uint8)
        self._size = np.array([(actor.length, actor.width) for actor in actors], dtype=np.float64).reshape(-1, 2).T
        self._present: Bool | None = None
        self._constant: Actors

    def assemble(self, movers: Rows) -> Actors:
        """Return the static actors and the present movers."""
        moving, present = self._all.copy(), movers["is_present"] != 0
        moving[:, self._rows] = movers["x"], movers["y"], movers["yaw"], movers["speed"]
        if self._present is None or not np.array_equal(self._present, present):
            self._select_present(present)
        constant = self._constant
        if len(constant.ids) < len(self._ids):
            moving = moving[:, self._is_shown]
        x, y, yaw, v = moving
        return Actors(constant.ids, constant.kind, x, y, yaw, v, constant.length, constant.width)

    def _select_present(self, present: Bool) -> None:
        self._present = present
        self._is_shown = np.ones(len(self._ids), dtype=np.bool_)
        self._is_shown[self._rows] = present
        ids = tuple(name for name, shown in zip(self._ids, self._is_shown.tolist(), strict=True) if shown)
        length, width = self._size[:, self._is_shown]
        zeros = np.zeros(len(ids))
        self._constant = Actors(ids, self._kind[self._is_shown], zeros, zeros, zeros, zeros, length, width)


ON_LANE_M = 2.0
"""An actor is on a lane if the centre line is at most this far away [m] and the headings agree."""
BESIDE_M = 0.5
"""[m] A CAV further than this to the right of an actor's path is to its right."""
LANE_WIDTH_M = 3.5
"""[m] Used where no lane is near."""


def compute_lane_change_offset(
    actor: Actor, path: MotionPath, pose: tuple[float, float, float], frame: Frame, roads: RoadMap
) -> float:
    """Return the lateral distance [m] from `at` (x, y, yaw) to the adjacent lane; negative to the right, 0 if none.

    An actor that follows lanes changes only to a lane of the map; one that follows a path moves by one lane width.
    """
    action = actor.action
    assert isinstance(action, LaneChange)
    left = (action.direction or _choose_direction(action, path, frame)) == "left"
    lane = _find_lane(pose, roads)
    neighbour = (lane.left if left else lane.right) if lane is not None else ""
    if lane is not None and neighbour:
        x, y = lane.centre.at(lane.centre.project(pose[0], pose[1])[0])
        return -roads.lanes[neighbour].centre.project(x, y)[1]
    if isinstance(actor.motion, LaneMotion):
        return 0.0
    width = lane.width if lane is not None else LANE_WIDTH_M
    return width if left else -width


def _choose_direction(action: LaneChange, path: MotionPath, frame: Frame) -> str:
    ego = frame.egos.get(action.target_vehicle or "")
    if ego is None:
        return "left"
    return "right" if path.line.project(ego.x, ego.y)[1] < -BESIDE_M else "left"


def _find_lane(pose: tuple[float, float, float], roads: RoadMap) -> Lane | None:
    nearest = roads.find_nearest_lanes(np.array([pose[:2]]))
    alignment = portable.cos(wrap_angle(pose[2] - float(nearest.yaw[0])))
    if nearest.distance[0] > ON_LANE_M or alignment < portable.cos(math.pi / 4):
        return None
    return roads.driving[int(nearest.lane[0])]

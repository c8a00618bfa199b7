"""The scripted actors of one episode, advanced tick by tick."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from mdrive_sumo.actors.actor_surroundings import CAR_SIZE, SurroundingsBuilder
from mdrive_sumo.actors.collision_avoidance import CollisionAvoidance
from mdrive_sumo.actors.motion_path import MotionPath, build_lane_change_path, build_motion_path
from mdrive_sumo.actors.motion_state import MotionState, MotionTarget, advance_motion, build_actor_params
from mdrive_sumo.actors.path_tables import PathPoints, build_path_tables
from mdrive_sumo.actors.trigger_script import (
    ActorPosition,
    ScriptPhase,
    advance_script,
    build_script_state,
    compute_target_speed,
    find_initial_speed,
)
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, box_corners, boxes_overlap, wrap_angle
from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors, Frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import (
    KIND_BY_NAME,
    Actor,
    LaneChange,
    LaneMotion,
    PathMotion,
    ReplayMotion,
    StandingMotion,
)

LOG_TIME_TOLERANCE_S = 1e-6
"""A replay whose own clock differs from the scenario's by less than this is at the pose of its log."""


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
        self._movers: list[Actor] = [actors[i] for i, _ in paths]
        self._paths: list[MotionPath] = [path for _, path in paths]
        self._tables = build_path_tables(self._paths)
        self._params = build_actor_params(self._movers)
        self._states = {
            i: build_script_state(actor) for i, actor in enumerate(self._movers) if actor.trigger is not None
        }
        self._held_until: dict[str, int] = {}
        self._assembler = ActorAssembler(actors, [i for i, _ in paths])
        static_ids = frozenset(actor.id for actor in actors if isinstance(actor.motion, StandingMotion))
        self._surroundings_builder = SurroundingsBuilder(
            {actor.id: i for i, actor in enumerate(self._movers)}, static_ids
        )
        avoids_collisions = [actor.avoid_collision and mode is ActorMode.DEFAULT for actor in self._movers]
        is_pedestrian = [actor.kind == "pedestrian" for actor in self._movers]
        self._collision_avoidance = CollisionAvoidance(
            np.array(avoids_collisions, np.bool_), np.array(is_pedestrian, np.bool_), self._params
        )
        self._stays_at_end = np.array(
            [not isinstance(a.motion, ReplayMotion) or a.motion.stays for a in self._movers], np.bool_
        )
        self._script_speed = np.array([_find_cruise_speed(actor) for actor in self._movers])
        self._motion = self._build_initial_state(scenario)
        self._points = self._tables.interpolate(self._motion.progress)
        self._frozen = False
        self.present: Actors = self._assemble()
        """The actors in the last frame; before the first `advance`, in frame 0."""

    def _build_initial_state(self, scenario: Scenario) -> MotionState:
        starts = {ego.id: (ego.start.x, ego.start.y) for ego in scenario.egos}
        speed = [find_initial_speed(actor, starts) for actor in self._movers]
        # A replay without a trigger runs on the scenario's clock.
        is_triggered = np.array([actor.trigger is not None for actor in self._movers], np.bool_)
        begin = np.where(self._params.is_timed & ~is_triggered, 0.0, self._tables.begin)
        logged = np.where(is_triggered, 0.0, self._tables.interpolate(begin).slope)
        return MotionState(begin, np.where(self._params.is_timed, logged, np.array(speed)), np.ones(len(speed)))

    def advance(self, frame: Frame, struck: Collection[str]) -> Actors:
        """Return the scripted actors one tick after `frame`, whose CAVs are those that have not ended.

        `struck`: ids of actors that a CAV touches in that frame; they stand for 2 s.
        """
        if not self._movers or self._frozen:
            return self.present
        if self._mode is ActorMode.ORIGINAL and self._leader not in frame.egos:
            self._frozen = True
            self.present = replace(self.present, speed=np.zeros(len(self.present)))
            return self.present
        self._held_until |= dict.fromkeys(struck, frame.tick + STRUCK_HOLD_TICKS)
        full_brake = self._advance_scripts(frame)
        target = MotionTarget(
            self._script_speed, self._compute_speed_limits(frame), full_brake, self._find_stopped(frame.tick)
        )
        self._motion = advance_motion(self._motion, self._points, target, self._params, self._tables)
        self._delay_blocked_entries(frame)
        self._points = self._tables.interpolate(self._motion.progress)
        self.present = self._assemble()
        return self.present

    def _advance_scripts(self, frame: Frame) -> Bool:
        """Advance the scripts of triggered actors; return an (M,) mask of the movers that brake fully."""
        full_brake = np.zeros(len(self._movers), np.bool_)
        for i, state in self._states.items():
            actor = self._movers[i]
            position = ActorPosition(float(self._points.x[i]), float(self._points.y[i]), float(self._motion.speed[i]))
            after = self._states[i] = advance_script(state, actor, position, frame)
            if after.phase is ScriptPhase.AFTER and state.phase is ScriptPhase.BEFORE:
                self._start_lane_change(i, frame)
            self._script_speed[i] = compute_target_speed(after, actor, position, frame)
            full_brake[i] = after.phase is ScriptPhase.BRAKING
        return full_brake

    def _start_lane_change(self, i: int, frame: Frame) -> None:
        actor, path, points = self._movers[i], self._paths[i], self._points
        if not isinstance(actor.action, LaneChange):
            return
        pose = (float(points.x[i]), float(points.y[i]), float(points.yaw[i]))
        offset = compute_lane_change_offset(actor, path, pose, frame, self._roads)
        if not offset:
            return
        self._paths[i], since = build_lane_change_path(path, float(points.s[i]), offset, actor)
        self._tables = build_path_tables(self._paths)
        progress = self._motion.progress.copy()
        progress[i] = since
        self._motion = replace(self._motion, progress=progress)
        self._points = self._tables.interpolate(progress)

    def _compute_speed_limits(self, frame: Frame) -> Float:
        surroundings = self._surroundings_builder.build(frame)
        now = frame.tick * DT
        is_on_log = self._params.is_timed & (np.abs(now - self._motion.progress) < LOG_TIME_TOLERANCE_S)
        return self._collision_avoidance.compute_speed_limits(
            self._motion, self._points, self._present, is_on_log, surroundings, self._tables
        )

    def _find_stopped(self, tick: int) -> Bool:
        """Return an (M,) mask of the movers that stand: struck, or not yet triggered."""
        standing = np.zeros(len(self._movers), np.bool_)
        for i, state in self._states.items():
            standing[i] = state.phase is ScriptPhase.WAITING
        self._held_until = {actor: until for actor, until in self._held_until.items() if tick < until}
        if self._held_until:
            standing |= np.array([actor.id in self._held_until for actor in self._movers], np.bool_)
        return standing

    def _delay_blocked_entries(self, frame: Frame) -> None:
        """Delay the entry of replays that would appear inside a CAV, unless they do not avoid collisions."""
        is_entering = self._find_present() & ~self._present
        if not is_entering.any() or self._mode is ActorMode.ORIGINAL or not frame.egos:
            return
        ego_boxes = np.stack([box_corners(ego.x, ego.y, ego.yaw, *CAR_SIZE) for ego in frame.egos.values()])
        progress = self._motion.progress.copy()
        for i in np.flatnonzero(is_entering).tolist():
            actor, path = self._movers[i], self._paths[i]
            box = box_corners(path.x[0], path.y[0], path.yaw[0], actor.length, actor.width)
            if actor.avoid_collision and boxes_overlap(box, ego_boxes).any():
                progress[i] -= DT
        self._motion = replace(self._motion, progress=progress)

    def _find_present(self) -> Bool:
        """Return an (M,) mask of the movers that are in the world."""
        progress, tables = self._motion.progress, self._tables
        is_over = (progress > tables.end + LOG_TIME_TOLERANCE_S) & ~self._stays_at_end
        return (progress >= tables.begin - LOG_TIME_TOLERANCE_S) & ~is_over

    def _assemble(self) -> Actors:
        self._present = self._find_present()
        return self._assembler.assemble(self._points, self._motion.speed, self._present)


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

    def assemble(self, points: PathPoints, speed: Float, present: Bool) -> Actors:
        """Return the static actors and the present movers; `points`, `speed` and `present` are (M,) over the movers."""
        moving = self._all.copy()
        moving[:, self._rows] = points.x, points.y, points.yaw, speed
        if self._present is None or not np.array_equal(self._present, present):
            self._select_present(present)
        constant = self._constant
        if len(constant.ids) < len(self._ids):
            moving = moving[:, self._is_shown]
        x, y, yaw, v = moving
        return Actors(constant.ids, constant.kind, x, y, yaw, v, constant.length, constant.width)

    def _select_present(self, present: Bool) -> None:
        self._present = present.copy()
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

"""Cast: the scripted road users of one episode, tick by tick."""

import math
from collections.abc import Collection
from dataclasses import replace
from enum import StrEnum

import numpy as np

from mdrive_sumo.actors.actor_assembler import Stage
from mdrive_sumo.actors.actor_surroundings import CAR, Onlooker
from mdrive_sumo.actors.collision_avoidance import Watch
from mdrive_sumo.actors.lane_change import lane_change_m
from mdrive_sumo.actors.motion_path import Course, course_of, shifted
from mdrive_sumo.actors.motion_state import Going, Wanted, fitness_of, gone_on
from mdrive_sumo.actors.path_tables import tables_of
from mdrive_sumo.actors.trigger_script import Own, Phase, first_cue, initial_speed_of, next_cue, target_speed
from mdrive_sumo.core.geometry import Bool, Float, box_corners, boxes_overlap
from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors, Frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, LaneChange, LaneMotion, PathMotion, ReplayMotion, StandingMotion

ON_TIME_S = 1e-6
"""A replay whose own clock is no later than this is where its log has it."""


class ActorMode(StrEnum):
    """`default`: scripted road users react, on a global clock. `original`: as in MDrive's code (protocol 3.5)."""

    DEFAULT = "default"
    ORIGINAL = "original"


class ScriptedActors:
    """Moves what a scenario scripts. `original`: nobody avoids anything, and all freeze when the first CAV ends."""

    def __init__(self, scenario: Scenario, roads: RoadMap, mode: ActorMode = ActorMode.DEFAULT) -> None:
        """Raises InputError for lanes that do not connect."""
        actors = sorted(scenario.actors, key=lambda actor: actor.id)
        courses = [(i, course) for i, actor in enumerate(actors) if (course := course_of(actor, roads)) is not None]
        self._roads, self._mode, self._leader = roads, mode, scenario.egos[0].id
        self._movers: list[Actor] = [actors[i] for i, _ in courses]
        self._courses: list[Course] = [course for _, course in courses]
        self._tables = tables_of(self._courses)
        self._fitness = fitness_of(self._movers)
        self._cues = {i: first_cue(actor) for i, actor in enumerate(self._movers) if actor.trigger is not None}
        self._held: dict[str, int] = {}
        self._stage = Stage(actors, [i for i, _ in courses])
        still = frozenset(actor.id for actor in actors if isinstance(actor.motion, StandingMotion))
        self._onlooker = Onlooker({actor.id: i for i, actor in enumerate(self._movers)}, still)
        watchful = [actor.avoid_collision and mode is ActorMode.DEFAULT for actor in self._movers]
        on_foot = [actor.kind == "pedestrian" for actor in self._movers]
        self._watch = Watch(np.array(watchful, np.bool_), np.array(on_foot, np.bool_), self._fitness)
        self._stays = np.array(
            [not isinstance(a.motion, ReplayMotion) or a.motion.stays for a in self._movers], np.bool_
        )
        self._target = np.array([_cruise(actor) for actor in self._movers])
        self._going = self._first(scenario)
        self._here = self._tables.places(self._going.progress)
        self._frozen = False
        self.present: Actors = self._shown()
        """Who is there in the last frame; at first, in frame 0."""

    def _first(self, scenario: Scenario) -> Going:
        starts = {ego.id: (ego.start.x, ego.start.y) for ego in scenario.egos}
        speed = [initial_speed_of(actor, starts) for actor in self._movers]
        # A replay's own clock is the scenario's, unless it has a trigger.
        waits = np.array([actor.trigger is not None for actor in self._movers], np.bool_)
        begin = np.where(self._fitness.timed & ~waits, 0.0, self._tables.begin)
        logged = np.where(waits, 0.0, self._tables.places(begin).slope)
        return Going(begin, np.where(self._fitness.timed, logged, np.array(speed)), np.ones(len(speed)))

    def advance(self, frame: Frame, struck: Collection[str]) -> Actors:
        """The scripted road users one tick after `frame`. Its CAVs are those that have not ended.

        `struck`: ids of actors that a CAV met in that frame; they stand for two seconds.
        """
        if not self._movers or self._frozen:
            return self.present
        if self._mode is ActorMode.ORIGINAL and self._leader not in frame.egos:
            self._frozen = True
            self.present = replace(self.present, speed=np.zeros(len(self.present)))
            return self.present
        self._held |= dict.fromkeys(struck, frame.tick + STRUCK_HOLD_TICKS)
        full_brake = self._follow_scripts(frame)
        wanted = Wanted(self._target, self._limits(frame), full_brake, self._standing(frame.tick))
        self._going = gone_on(self._going, self._here, wanted, self._fitness, self._tables)
        self._let_in(frame)
        self._here = self._tables.places(self._going.progress)
        self.present = self._shown()
        return self.present

    def _follow_scripts(self, frame: Frame) -> Bool:
        """Cues of the triggered; whether each mover (M,) brakes with all it has."""
        full_brake = np.zeros(len(self._movers), np.bool_)
        for i, cue in self._cues.items():
            actor = self._movers[i]
            own = Own(float(self._here.x[i]), float(self._here.y[i]), float(self._going.speed[i]))
            after = self._cues[i] = next_cue(cue, actor, own, frame)
            if after.phase is Phase.AFTER and cue.phase is Phase.BEFORE:
                self._change_lane(i, frame)
            self._target[i] = target_speed(after, actor, own, frame)
            full_brake[i] = after.phase is Phase.BRAKING
        return full_brake

    def _change_lane(self, i: int, frame: Frame) -> None:
        actor, course, here = self._movers[i], self._courses[i], self._here
        if not isinstance(actor.action, LaneChange):
            return
        at = (float(here.x[i]), float(here.y[i]), float(here.yaw[i]))
        aside = lane_change_m(actor, course, at, frame, self._roads)
        if not aside:
            return
        self._courses[i], since = shifted(course, float(here.s[i]), aside, actor)
        self._tables = tables_of(self._courses)
        progress = self._going.progress.copy()
        progress[i] = since
        self._going = replace(self._going, progress=progress)
        self._here = self._tables.places(progress)

    def _limits(self, frame: Frame) -> Float:
        around = self._onlooker.around(frame)
        now = frame.tick * DT
        on_time = self._fitness.timed & (np.abs(now - self._going.progress) < ON_TIME_S)
        return self._watch.limits(self._going, self._here, self._present, on_time, around, self._tables)

    def _standing(self, tick: int) -> Bool:
        """Who stands at once (M,): struck, or not yet set off."""
        standing = np.zeros(len(self._movers), np.bool_)
        for i, cue in self._cues.items():
            standing[i] = cue.phase is Phase.WAITING
        self._held = {actor: until for actor, until in self._held.items() if tick < until}
        if self._held:
            standing |= np.array([actor.id in self._held for actor in self._movers], np.bool_)
        return standing

    def _let_in(self, frame: Frame) -> None:
        """A replay that would appear inside a CAV waits outside until there is room, unless it minds nothing."""
        coming = self._there() & ~self._present
        if not coming.any() or self._mode is ActorMode.ORIGINAL or not frame.egos:
            return
        cavs = np.stack([box_corners(ego.x, ego.y, ego.yaw, CAR.length, CAR.width) for ego in frame.egos.values()])
        progress = self._going.progress.copy()
        for i in np.flatnonzero(coming).tolist():
            actor, course = self._movers[i], self._courses[i]
            box = box_corners(course.x[0], course.y[0], course.yaw[0], actor.length, actor.width)
            if actor.avoid_collision and boxes_overlap(box, cavs).any():
                progress[i] -= DT
        self._going = replace(self._going, progress=progress)

    def _there(self) -> Bool:
        """Which movers are in the world (M,)."""
        progress, tables = self._going.progress, self._tables
        late = (progress > tables.end + ON_TIME_S) & ~self._stays
        return (progress >= tables.begin - ON_TIME_S) & ~late

    def _shown(self) -> Actors:
        self._present = self._there()
        return self._stage.actors(self._here, self._going.speed, self._present)


def _cruise(actor: Actor) -> float:
    """Speed [m/s] without a script; a replay has its log's."""
    return actor.motion.speed if isinstance(actor.motion, PathMotion | LaneMotion) else math.inf

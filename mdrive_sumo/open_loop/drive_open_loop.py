"""Show agents the frames of a recording, and compare each plan and each detection with it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Control, Reply, SensingTrack
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import End, Frame
from mdrive_sumo.episode import EpisodeRecord, rebuild_frame
from mdrive_sumo.loop import EpisodeConfig, start_agents
from mdrive_sumo.loop.agent_driver import AgentDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.open_loop.detection_precision import DetectionCounts, match_frame
from mdrive_sumo.open_loop.plan_errors import HORIZON_TICKS, PlanErrors, compute_plan_errors

TRUTH_RANGE_M = 70.0
"""Road users this far from the CAV [m] count in average precision, hidden ones as well: our own choice."""


@dataclass
class OpenLoopSamples:
    """What was scored in one recording."""

    errors: list[PlanErrors] = field(default_factory=lambda: [])
    detections: DetectionCounts | None = None
    """None if no agent replied detections."""
    skipped: Counter[str] = field(default_factory=lambda: Counter[str]())
    """Number of replies that could not be scored, by reason."""
    failures: dict[str, str] = field(default_factory=lambda: {})
    """Why the agent of a CAV failed, by CAV."""
    sensing_track: SensingTrack = SensingTrack.OBJECT


def drive_open_loop(
    config: EpisodeConfig, episode: EpisodeRecord, drivers: Mapping[str, AgentDriver]
) -> OpenLoopSamples:
    """Drive nothing: ask the agents of all CAVs for replies to recorded frames, and score them.

    Messages go over the channel as in closed loop. Raises InputError for an invalid sensor.
    """
    samples = OpenLoopSamples()
    simulation = start_agents(config, RecordedFrames(episode), drivers)
    scheduler = AgentScheduler(drivers, config.options.clock, (), simulation.fail_agent)
    columns = {ego: column for column, ego in enumerate(episode.ego_ids)}
    people = _list_person_ticks(episode)
    observations = simulation.reset()
    while not simulation.is_done:
        tick = simulation.tick
        replies = scheduler.collect_replies(tick, observations)
        for ego, reply in replies.items():
            if people is not None and tick not in people[ego]:
                samples.skipped["no 3 s of a person"] += 1
            else:
                _score_reply(samples, episode, tick, columns[ego], reply)
        observations = simulation.step(replies, busy=scheduler.find_busy(tick + 1))
    samples.failures, samples.sensing_track = simulation.failed_agents, simulation.sensing_track
    return samples


def _list_person_ticks(episode: EpisodeRecord) -> dict[str, set[int]] | None:
    """Return the ticks, by CAV, from which on a person drives for the 3 s of a plan; None unless it is a take.

    What an agent drove in between is no demonstration. Raises InputError for a take with damaged notes.
    """
    if episode.about.get("agent") != HUMAN:
        return None
    found: dict[str, set[int]] = {}
    for ego in episode.ego_ids:
        driven = set(RecordedActions(episode, ego).list_person_ticks())
        found[ego] = {tick for tick in driven if driven.issuperset(range(tick, tick + HORIZON_TICKS))}
    return found


def _score_reply(samples: OpenLoopSamples, episode: EpisodeRecord, tick: int, column: int, reply: Reply) -> None:
    if reply.detections is not None:
        samples.detections = samples.detections or DetectionCounts()
        samples.detections.add(match_frame(reply.detections, _find_truth(episode, tick, column)))
    if reply.plan is None:
        samples.skipped["no plan"] += 1
        return
    errors = compute_plan_errors(episode, tick, column, reply.plan)
    if errors is None:
        samples.skipped["no 3 s to compare"] += 1
    else:
        samples.errors.append(errors)


def _find_truth(episode: EpisodeRecord, tick: int, column: int) -> Float:
    """Return the boxes (M, 5) of all other road users and obstacles within range of a CAV."""
    x, y = episode.x[tick], episode.y[tick]
    near = episode.valid[tick] & (portable.hypot(x - x[column], y - y[column]) <= TRUTH_RANGE_M)
    near[column] = False
    rows = np.flatnonzero(near)
    state = (x[rows], y[rows], episode.yaw[tick, rows], episode.length[rows], episode.width[rows])
    return np.stack(state, axis=-1)


STRIDE = 4
"""Ticks between frames: 5 Hz, the rate at which the systems of the paper plan; logs have 10 Hz (protocol 13.1)."""


class RecordedFrames:
    """Every fourth frame of a recording; a CAV ends with the last frame in which it is in the world."""

    def __init__(self, episode: EpisodeRecord) -> None:
        """Raises InputError for an episode in which a CAV is not in the world in tick 0."""
        if not episode.valid[0, : episode.egos].all():
            raise InputError(f"episode of {episode.scenario}: expected all CAVs in the world in tick 0, found others")
        self._episode = episode
        self._columns = {ego: column for column, ego in enumerate(episode.ego_ids)}
        self._changes = list(episode.signals)
        self._signals: dict[str, str] = {}

    @property
    def dimensions(self) -> Mapping[str, tuple[float, float]]:
        """(length, width) [m] of every CAV in the recording: in that of a log its own."""
        sizes = zip(self._episode.length.tolist(), self._episode.width.tolist(), strict=True)
        return dict(zip(self._episode.ego_ids, sizes, strict=False))

    def start(self) -> Frame:
        """Return the frame of tick 0."""
        return self._build_frame(0)

    def advance(self, frame: Frame, controls: Mapping[str, Control]) -> Frame:
        """Return the recorded frame four ticks later, whatever the controls are."""
        del controls
        return self._build_frame(frame.tick + STRIDE)

    def find_ends(self, frame: Frame, active: Sequence[str]) -> Mapping[str, End]:
        """Return the recorded ends of the CAVs that have no further frame."""
        after = frame.tick + STRIDE
        return {
            ego: self._episode.find_ending(ego).end
            for ego in active
            if after >= self._episode.ticks or not self._episode.valid[after, self._columns[ego]]
        }

    def _build_frame(self, tick: int) -> Frame:
        frame = rebuild_frame(self._episode, tick)
        while self._changes and self._changes[0].tick <= tick:
            change = self._changes.pop(0)
            self._signals[change.light] = change.state
        return Frame(tick, frame.egos, frame.actors, dict(self._signals))

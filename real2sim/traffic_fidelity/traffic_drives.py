"""Drives of a converted scenario as agents meet it: the background alone, and with `omniscient` in every CAV.

Unlike `log_simulation`, nothing repeats the log but the schedules: scripted actors stop for what is in their way, and
the drives go on after the log has ended, because an agent that is slower than the log is still under way then.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Actors, Frame, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate.screening import drive_episode
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo import SumoWorld

ALONE, OMNISCIENT = "alone", "omniscient"
AFTER_LOG_S = 30.0
"""[s] The background alone drives on this long after the log: as long as a CAV may stand before it is blocked."""
SAMPLE_TICKS = 10
"""Interval between two samples of a drive: 0.5 s."""
SAMPLE_S = SAMPLE_TICKS * DT


@dataclass(frozen=True)
class TrafficDrive:
    """All road users of one drive, every `SAMPLE_S`. Arrays of states are (K, N), NaN where a road user is absent."""

    name: str
    """`ALONE` or `OMNISCIENT`."""
    ids: tuple[str, ...]
    length: Float
    """Lengths (N,) [m] of the road users."""
    width: Float
    """Widths (N,) [m] of the road users."""
    x: Float
    y: Float
    yaw: Float
    speed: Float


def drive_alone(scenario: Scenario, roads: RoadMap, log_s: float) -> TrafficDrive:
    """Drive the background and the scripted actors without any CAV, `AFTER_LOG_S` longer than the log.

    Needs the process's only SUMO simulation. Raises WorldError or InputError as `SumoWorld` does.
    """
    scripted = ScriptedActors(scenario, roads)
    samples: list[Actors] = []
    with SumoWorld(scenario, roads, {}, 0) as world:
        frame = _build_frame(0, world.start({}, scripted.present), scripted.present)
        for tick in range(1, round((log_s + AFTER_LOG_S) / DT) + 1):
            if frame.tick % SAMPLE_TICKS == 0:
                samples.append(frame.actors)
            actors = scripted.advance(frame, ())
            frame = _build_frame(tick, world.advance({}, actors, ()), actors)
    return _stack_samples(samples)


def _build_frame(tick: int, around: WorldState, scripted: Actors) -> Frame:
    return Frame(tick, {}, around.actors.merge(scripted), around.signals)


def _stack_samples(samples: Sequence[Actors]) -> TrafficDrive:
    ids = tuple(sorted({id_ for sample in samples for id_ in sample.ids}))
    column = {id_: k for k, id_ in enumerate(ids)}
    states = np.full((4, len(samples), len(ids)), np.nan)
    sizes = np.zeros((2, len(ids)))
    for k, sample in enumerate(samples):
        columns = [column[id_] for id_ in sample.ids]
        states[:, k, columns] = sample.x, sample.y, sample.yaw, sample.speed
        sizes[:, columns] = sample.length, sample.width
    return TrafficDrive(ALONE, ids, *sizes, *states)


def drive_with_omniscient(scenario: Scenario, roads: RoadMap) -> TrafficDrive:
    """Drive an episode with `omniscient` in every CAV. Raises WorldError or InputError as `drive_episode` does."""
    return _sample_episode(drive_episode(scenario, roads, OMNISCIENT))


def _sample_episode(episode: EpisodeRecord) -> TrafficDrive:
    there: npt.NDArray[np.bool_] = episode.valid[::SAMPLE_TICKS]
    states = (episode.x, episode.y, episode.yaw, episode.speed)
    x, y, yaw, speed = (np.where(there, values[::SAMPLE_TICKS], np.nan) for values in states)
    return TrafficDrive(OMNISCIENT, episode.ids, episode.length, episode.width, x, y, yaw, speed)

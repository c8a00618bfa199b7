"""Background vehicles that stall: they stand far longer than they did in the log, and nothing ahead explains it.

The log shows that every vehicle got where it went. One that stands for ever in the simulation, because it waits for
another one that waits for it, or because its lane ends before it has changed lanes, blocks the traffic behind it. The
log's own drive does not show it, because there the schedules carry the vehicles; so traffic is driven as agents meet
it: the background alone, and with `omniscient` in every CAV. Unlike in `log_simulation`, nothing repeats the log but
the schedules: scripted actors stop for what is in their way, and the drives go on after the log has ended, because an
agent that is slower than the log is still under way then.

A vehicle behind another background vehicle or a CAV is in a queue, and the head of the queue is judged in its place;
only where vehicles wait for each other in a circle is each of them judged. Networks of logs have no traffic lights, so
no vehicle waits for one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors, Frame, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.recording import RecordedTrack

ALONE, OMNISCIENT = "alone", "omniscient"
AFTER_LOG_S = 30.0
"""[s] The background alone drives on this long after the log: as long as a CAV may stand before it is blocked."""
SAMPLE_TICKS = 10
"""Interval between two samples of a drive: 0.5 s."""
SAMPLE_S = SAMPLE_TICKS * DT
STALLED_S = 10.0
"""[s] A vehicle that stands this much longer than ever in its log stalls. A wait for the cross traffic of a log of
seconds is shorter; a CAV is blocked after 30 s."""
STANDING_MPS = 0.1
"""[m/s] A slower vehicle stands."""
QUEUE_M = 6.0
"""[m] A road user this near ahead of the front bumper is what a vehicle stands behind: twice the largest gap that
drivers of a log are given (2.5 m), and a metre for the bend."""


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
    from mdrive_sumo.sumo import SumoWorld  # only here: the process that starts the workers never simulates

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
    from mdrive_sumo.generate.built_in_drive import drive_episode  # only here, as above

    return _sample_episode(drive_episode(scenario, roads, OMNISCIENT))


def _sample_episode(episode: EpisodeRecord) -> TrafficDrive:
    there: npt.NDArray[np.bool_] = episode.valid[::SAMPLE_TICKS]
    states = (episode.x, episode.y, episode.yaw, episode.speed)
    x, y, yaw, speed = (np.where(there, values[::SAMPLE_TICKS], np.nan) for values in states)
    return TrafficDrive(OMNISCIENT, episode.ids, episode.length, episode.width, x, y, yaw, speed)


class StalledVehicle(BaseModel):
    """A background vehicle that stalls in one of the drives."""

    model_config = ConfigDict(frozen=True)

    id: str
    drive: str
    """"alone": the background without CAVs; "omniscient": with that agent in every CAV."""
    from_s: float
    to_s: float
    """[s] Since the start of the scenario; the drive may end then."""
    log_s: float
    """[s] The longest time for which it stands in the log."""
    x: float
    y: float
    """Position [m] where it stands."""
    behind: str = ""
    """The road user directly ahead of it: a scripted actor, or one of a circle of vehicles; "": none."""

    def format_sentence(self) -> str:
        """Return what happened, as a clause."""
        ahead = f"behind {self.behind}" if self.behind else "with nothing directly ahead"
        return (
            f"{self.id} stands from {self.from_s:g} s to {self.to_s:g} s at ({self.x:.1f}, {self.y:.1f}) {ahead},"
            f" {self.log_s:g} s at most in the log ({self.drive})"
        )


def measure_stalled_traffic(
    scenario: Scenario, roads: RoadMap, tracks: Sequence[RecordedTrack], names: Mapping[str, str], dt_s: float
) -> tuple[StalledVehicle, ...]:
    """Drive the scenario alone and with `omniscient`; return the vehicles that stall, by drive and id.

    `names`: track id -> id in the scenario. Needs the process's only SUMO simulation. Raises WorldError or InputError.
    """
    background = {vehicle.id for vehicle in scenario.background.vehicles}
    if not background:
        return ()
    logged = {names[track.id]: compute_longest_stand(track, dt_s) for track in tracks if names[track.id] in background}
    frames = max(len(track.valid) for track in tracks)
    drives = (drive_alone(scenario, roads, (frames - 1) * dt_s), drive_with_omniscient(scenario, roads))
    cavs = {ego.id for ego in scenario.egos}
    return tuple(stalled for drive in drives for stalled in find_stalled(drive, logged, cavs))


def compute_longest_stand(track: RecordedTrack, dt_s: float) -> float:
    """Return the longest time [s] for which a track stands."""
    step = np.hypot(np.diff(track.x), np.diff(track.y))
    with np.errstate(invalid="ignore"):
        stands = step < STANDING_MPS * dt_s
    return max(((last - first) * dt_s for first, last in _find_stretches(stands)), default=0.0)


def find_stalled(drive: TrafficDrive, logged: Mapping[str, float], cavs: set[str]) -> tuple[StalledVehicle, ...]:
    """Return the background vehicles that stall in a drive, by id.

    `logged`: the longest stand [s] in the log, by id; `cavs`: ids of the CAVs.
    """
    stands: dict[str, tuple[int, int]] = {}
    with np.errstate(invalid="ignore"):
        standing = np.abs(drive.speed) < STANDING_MPS
    for column, id_ in enumerate(drive.ids):
        if id_ in logged:
            longest = max(
                _find_stretches(standing[:, column]), key=lambda stretch: stretch[1] - stretch[0], default=(0, 0)
            )
            if (longest[1] - longest[0]) * SAMPLE_S > logged[id_] + STALLED_S:
                stands[id_] = longest
    ahead = {id_: _find_ahead(drive, id_, last - 1) for id_, (_, last) in stands.items()}
    return tuple(
        _build_stalled(drive, id_, stretch, logged[id_], ahead[id_])
        for id_, stretch in sorted(stands.items())
        if ahead[id_] not in cavs and (ahead[id_] not in logged or id_ in _follow_ahead(ahead, id_))
    )


def _find_stretches(mask: Bool) -> Iterable[tuple[int, int]]:
    """Return the runs of True as (first, end) indices."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return list(pairwise(edges.tolist()))[::2]


def _follow_ahead(ahead: Mapping[str, str], id_: str) -> set[str]:
    """Return the road users that are reached from the one ahead of `id_`, each by the one ahead of it."""
    reached: set[str] = set()
    while (id_ := ahead.get(id_, "")) and id_ not in reached:
        reached.add(id_)
    return reached


def _find_ahead(drive: TrafficDrive, id_: str, sample: int) -> str:
    """Return the nearest road user whose box is in the strip of `QUEUE_M` before the front bumper; "" if none is."""
    k = drive.ids.index(id_)
    x, y, yaw = (float(values[sample, k]) for values in (drive.x, drive.y, drive.yaw))
    middle = (drive.length[k] + QUEUE_M) / 2
    strip = boxes_corners(
        np.array(x + np.cos(yaw) * middle),
        np.array(y + np.sin(yaw) * middle),
        np.array(yaw),
        np.array(QUEUE_M),
        np.array(drive.width[k]),
    )
    others = np.flatnonzero(np.isfinite(drive.x[sample]) & (np.arange(len(drive.ids)) != k))
    there_x, there_y, there_yaw = (values[sample, others] for values in (drive.x, drive.y, drive.yaw))
    boxes = boxes_corners(there_x, there_y, there_yaw, drive.length[others], drive.width[others])
    hit = others[boxes_overlap(boxes, strip)]
    if not len(hit):
        return ""
    apart: Float = np.hypot(drive.x[sample, hit] - x, drive.y[sample, hit] - y)
    return drive.ids[int(hit[np.argmin(apart)])]


def _build_stalled(drive: TrafficDrive, id_: str, stretch: tuple[int, int], log_s: float, ahead: str) -> StalledVehicle:
    first, end = stretch
    k = drive.ids.index(id_)
    return StalledVehicle(
        id=id_,
        drive=drive.name,
        from_s=first * SAMPLE_S,
        to_s=end * SAMPLE_S,
        log_s=round(log_s, 3),
        x=round(float(drive.x[end - 1, k]), 2),
        y=round(float(drive.y[end - 1, k]), 2),
        behind=ahead,
    )

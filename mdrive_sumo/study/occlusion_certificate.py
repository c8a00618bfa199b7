"""Occlusion certificates: the intervals before a conflict in which a CAV cannot see a road user that others see.

They show what perception sharing can gain in a scenario. Two drives are analysed: at constant speed, where conflicts
become collisions, and the omniscient one, where conflicts are resolved. `mdrive-sumo validate SUITE
--write` keeps the certificates beside the suite; `mdrive-sumo list scenarios` shows them and filters by them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord, rebuild_frame
from mdrive_sumo.episode.episode_options import EpisodeOptions, StationIds
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sensing.observation_builder import build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensorPose
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from mdrive_sumo.study.certificate_file import CertificateFile, CertificatePart, ScenarioCertificate

CERTIFICATE_FILE = "occlusion.json"
EVERY_TICKS = 4
"""Ticks between two looks, 5 a second."""
RANGE_M = 80.0
"""Range of vision of a CAV."""
MIN_VISIBLE_SHARE = 0.1
"""A road user with a smaller visible share of its angular width counts as hidden."""
ENCROACHMENT_S = 3.0
"""Two road users are in conflict if they use the same place within this time."""
CLEARANCE_M = 0.3
"""Boxes never overlap in a recording, not even in a collision: they are grown by this for the test."""
MIN_INTERVAL_S = 1.0
"""A shorter interval does not matter."""
MAX_LEAD_S = 4.0
"""An interval matters if it ends less than this before the conflict: later only braking is left."""

ReferenceDrive = Literal["constant-speed", "omniscient"]
DRIVES: tuple[ReferenceDrive, ...] = ("constant-speed", "omniscient")
REFERENCE_OPTIONS = EpisodeOptions(sensing=SensingProfile.PERFECT, station_ids=StationIds.SCENARIO)
"""Of reference drives: difficulty, hidden conflicts and times depend neither on errors of sensors nor on drawn ids, by
which `omniscient` orders CAVs that are equal in everything else."""


class OccludedInterval(CertificatePart):
    """`actor` is hidden from `ego` from start_s to end_s, is known to each of `by`, and is met at conflict_s."""

    drive: ReferenceDrive
    ego: str
    actor: str
    start_s: float
    end_s: float
    conflict_s: float
    by: tuple[str, ...]
    """CAVs and RSUs that see it, and the actor itself if it is a CAV."""

    @property
    def matters(self) -> bool:
        """Whether the interval is long and late enough for a message to help."""
        return self.end_s - self.start_s >= MIN_INTERVAL_S and self.conflict_s - self.end_s < MAX_LEAD_S


class OcclusionCertificate(ScenarioCertificate):
    """All occluded intervals of a scenario."""

    hidden: tuple[OccludedInterval, ...]

    @property
    def occluded(self) -> bool:
        """Whether an interval matters."""
        return any(interval.matters for interval in self.hidden)

    @property
    def longest_s(self) -> float:
        """Length of the longest interval that matters [s]; 0 if there is none."""
        return max((interval.end_s - interval.start_s for interval in self.hidden if interval.matters), default=0.0)

    @property
    def by_third(self) -> bool:
        """Whether a station other than the hidden road user itself knows of it in an interval that matters."""
        return any(set(interval.by) - {interval.actor} for interval in self.hidden if interval.matters)


class OcclusionCertificateFile(CertificateFile[OcclusionCertificate]):
    """`occlusion.json` of a suite."""

    NAME = CERTIFICATE_FILE
    format: Literal["mdrive-sumo/occlusion/1"] = "mdrive-sumo/occlusion/1"


def find_occluded_intervals(
    drive: ReferenceDrive, episode: EpisodeRecord, scenario: Scenario, roads: RoadMap
) -> tuple[OccludedInterval, ...]:
    """Return the intervals of one recorded drive, sorted by CAV and time."""
    analysis = _VisibilityAnalysis(episode, scenario, roads)
    intervals = [hidden for ego in range(episode.egos) for hidden in analysis.of(drive, ego)]
    return tuple(sorted(intervals, key=lambda hidden: (hidden.ego, hidden.start_s, hidden.actor)))


@dataclass(frozen=True)
class _VisibilityAnalysis:
    """Visibility between road users in a recording, at every `EVERY_TICKS`-th tick (K ticks, N road users)."""

    episode: EpisodeRecord
    scenario: Scenario
    roads: RoadMap

    @cached_property
    def ticks(self) -> Int:
        return np.arange(0, self.episode.ticks, EVERY_TICKS)

    @cached_property
    def corners(self) -> Float:
        """(K, N, 4, 2) of all boxes, grown by the clearance."""
        e = self.episode
        place = (e.x[self.ticks], e.y[self.ticks], e.yaw[self.ticks])
        return boxes_corners(*place, e.length + CLEARANCE_M, e.width + CLEARANCE_M)

    @cached_property
    def centres(self) -> Float:
        """(K, N, 2)"""
        return np.stack((self.episode.x[self.ticks], self.episode.y[self.ticks]), axis=-1)

    @cached_property
    def radii(self) -> Float:
        """(N,) of circles around the boxes; where they do not touch, boxes cannot."""
        return portable.hypot(self.episode.length + CLEARANCE_M, self.episode.width + CLEARANCE_M) / 2

    @cached_property
    def seen(self) -> Mapping[str, Bool]:
        """Observer id -> (K, N) whether it sees each road user; an absent observer sees none."""
        buildings = BuildingEdges(self.roads)
        views = {name: np.zeros((len(self.ticks), len(self.episode.ids)), dtype=np.bool_) for name in self._observers}
        for k, tick in enumerate(self.ticks.tolist()):
            columns = np.flatnonzero(self.episode.valid[tick])
            scene = build_sensing_frame(rebuild_frame(self.episode, tick, columns), self._sizes)
            for name, eye in self._list_sensor_poses(tick, columns):
                views[name][k, columns] = (
                    SightView(eye, scene, buildings, RANGE_M).visible_fractions() >= MIN_VISIBLE_SHARE
                )
        return views

    @property
    def _observers(self) -> tuple[str, ...]:
        return (*self.episode.ego_ids, *(rsu.id for rsu in self.scenario.rsus))

    @property
    def _sizes(self) -> dict[str, tuple[float, float]]:
        e = self.episode
        return {ego: (float(e.length[i]), float(e.width[i])) for i, ego in enumerate(e.ego_ids)}

    def _list_sensor_poses(self, tick: int, columns: Int) -> Iterator[tuple[str, SensorPose]]:
        e = self.episode
        for row, i in enumerate(columns[columns < e.egos].tolist()):
            yield e.ids[i], SensorPose(float(e.x[tick, i]), float(e.y[tick, i]), float(e.yaw[tick, i]), row)
        for rsu in self.scenario.rsus:
            yield rsu.id, SensorPose(rsu.x, rsu.y, 0.0, None)

    def of(self, drive: ReferenceDrive, ego: int) -> Iterator[OccludedInterval]:
        """Yield the intervals of one CAV."""
        for actor in range(len(self.episode.ids)):
            meeting = self._find_meeting(ego, actor) if actor != ego else None
            if meeting is not None:
                yield from self._find_intervals(drive, ego, actor, meeting)

    def _find_meeting(self, ego: int, actor: int) -> int | None:
        """Return the first tick index at which CAV and actor use one place within `ENCROACHMENT_S`, or None."""
        reach = round(ENCROACHMENT_S / DT / EVERY_TICKS)
        valid, (mine, theirs) = self.episode.valid[self.ticks], (self.centres[:, i] for i in (ego, actor))
        room = self.radii[ego] + self.radii[actor]
        first: int | None = None
        for lag in range(-reach, reach + 1):
            k = np.arange(max(0, -lag), len(self.ticks) - max(0, lag))
            k = k[valid[k, ego] & valid[k + lag, actor] & (portable.hypot(*(mine[k] - theirs[k + lag]).T) < room)]
            met = k[boxes_overlap(self.corners[k, ego], self.corners[k + lag, actor])]
            if len(met) and (first is None or met[0] < first):
                first = int(met[0])
        return first

    def _find_intervals(self, drive: ReferenceDrive, ego: int, actor: int, meeting: int) -> Iterator[OccludedInterval]:
        ids, valid = self.episode.ids, self.episode.valid[self.ticks][: meeting + 1]
        near = portable.hypot(*(self.centres[: meeting + 1, ego] - self.centres[: meeting + 1, actor]).T)
        hidden = valid[:, ego] & valid[:, actor] & (near < RANGE_M) & ~self.seen[ids[ego]][: meeting + 1, actor]
        others = [name for name in self._observers if name not in (ids[ego], ids[actor])]
        seen_by_other = {name: self.seen[name][: meeting + 1, actor] for name in others}
        if actor < self.episode.egos:
            seen_by_other[ids[actor]] = valid[:, actor]
        known_hidden = hidden & np.any([np.zeros_like(hidden), *seen_by_other.values()], axis=0)
        for first, last in _find_runs(known_hidden):
            by = tuple(name for name, sees in seen_by_other.items() if sees[first : last + 1].mean() >= 0.5)
            times = (round(float(self.ticks[i]) * DT, 2) for i in (first, last, meeting))
            start_s, end_s, conflict_s = times
            yield OccludedInterval(
                drive=drive, ego=ids[ego], actor=ids[actor], start_s=start_s, end_s=end_s, conflict_s=conflict_s, by=by
            )


def _find_runs(mask: Bool) -> Iterator[tuple[int, int]]:
    """Yield (first, last) index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(((False,), mask, (False,))).astype(np.int8)))
    for first, after in edges.reshape(-1, 2).tolist():
        yield first, after - 1

"""Score the logged drive of a log's CAVs as a live episode is scored.

The drivers of a log keep to its roads, so an infraction is either an error of the conversion (map, offset, box, route)
or one that the driver committed; a person decides which, see `confirmed_infractions`.
"""

import math
from collections.abc import Mapping, Sequence

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import criteria
from mdrive_sumo.scoring.metrics import EgoTrack, InfractionEvent, build_ego_track, find_infractions
from mdrive_sumo.scoring.metrics.lane_infractions import OUTSIDE_LANES, find_infringing_ticks
from real2sim.logged_drive.confirmed_infractions import ConfirmedInfraction, describe_unused
from real2sim.logged_drive.logged_episode import record_logged_drive
from real2sim.recording import RecordedTrack
from real2sim.tracks.kinematics import find_runs


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True)


class LoggedInfraction(_Part):
    """An infraction of a logged drive."""

    kind: str
    time_s: float
    x: float
    y: float
    """[m] Position of the CAV at `from_s`."""
    factor: float
    """Penalty factor; 1.0 for a mark without a penalty."""
    other: str = ""
    """The other road user, or the stop sign."""
    from_s: float
    to_s: float
    """When it happened: for "outside-lanes", which the scorer counts at the end, the longest stretch outside
    lanes or on a wrong lane; else `time_s`."""
    reason: str = ""
    """Why a person confirmed that the driver of the log did this; "": not confirmed."""
    confirmed_by: str = ""

    @property
    def is_confirmed(self) -> bool:
        """Whether a person has confirmed it."""
        return bool(self.confirmed_by)


class LoggedCav(_Part):
    """The logged drive of one CAV."""

    id: str
    """Id of the CAV in the scenario."""
    end: str
    """How a criterion of the benchmark ended the drive; "log ended" if none did before the log ended."""
    duration_s: float
    rc: float
    """Route completion [%] at its end; a route that was extended beyond the log is not completed."""
    ip: float
    """Infraction penalty of all its infractions, confirmed or not."""
    infractions: tuple[LoggedInfraction, ...]


class LoggedDrive(_Part):
    """The verdict of the scorer on the CAVs' own tracks."""

    cavs: tuple[LoggedCav, ...]
    notes: tuple[str, ...] = ()
    """Confirmations that match nothing."""

    @property
    def unconfirmed(self) -> tuple[tuple[str, LoggedInfraction], ...]:
        """The infractions that no person has confirmed, with the id of their CAV."""
        return tuple(
            (cav.id, infraction) for cav in self.cavs for infraction in cav.infractions if not infraction.is_confirmed
        )

    @property
    def confirmed_count(self) -> int:
        """Number of confirmed infractions."""
        return sum(infraction.is_confirmed for cav in self.cavs for infraction in cav.infractions)


def score_logged_drive(
    scenario: Scenario,
    roads: RoadMap,
    tracks: Sequence[RecordedTrack],
    names: Mapping[str, str],
    dt_s: float,
    confirmed: Sequence[ConfirmedInfraction] = (),
) -> LoggedDrive:
    """Drive every CAV along its track, with everything else as in the log, and score it.

    `names`: track id -> id in the scenario. `confirmed`: those of other scenarios are ignored.
    """
    episode = record_logged_drive(scenario, roads, {names[track.id]: track for track in tracks}, dt_s)
    own = [confirmation for confirmation in confirmed if confirmation.scenario == scenario.id]
    used: set[int] = set()
    cavs: list[LoggedCav] = []
    for column, ego in enumerate(scenario.egos):
        track = build_ego_track(episode.record, scenario, roads, column)
        events = find_infractions(track)
        cavs.append(
            LoggedCav(
                id=ego.id,
                end=episode.end_by_cav[ego.id],
                duration_s=_to_seconds(track.ending.tick),
                rc=round(criteria.compute_completion_percent(episode.progress[ego.id], track.reference), 2),
                ip=round(math.prod(event.factor for event in events), 4),
                infractions=tuple(_build_infraction(track, event, own, used) for event in events),
            )
        )
    unused = [confirmation for k, confirmation in enumerate(own) if k not in used]
    return LoggedDrive(cavs=tuple(cavs), notes=describe_unused(unused))


def _to_seconds(tick: int) -> float:
    return tick / TICKS_PER_SECOND


def _build_infraction(
    track: EgoTrack, event: InfractionEvent, confirmed: Sequence[ConfirmedInfraction], used: set[int]
) -> LoggedInfraction:
    """Return the infraction with its confirmation, whose number is added to `used`: each holds for one infraction."""
    time_s = _to_seconds(event.tick)
    match = next(
        (
            k
            for k, confirmation in enumerate(confirmed)
            if k not in used
            and confirmation.cav == track.ego.id
            and confirmation.covers(event.kind, time_s, event.factor)
        ),
        None,
    )
    if match is not None:
        used.add(match)
    entry = None if match is None else confirmed[match]
    first, last = _find_stretch(track, event)
    return LoggedInfraction(
        kind=event.kind,
        time_s=time_s,
        x=round(float(track.xy[first, 0]), 2),
        y=round(float(track.xy[first, 1]), 2),
        factor=round(event.factor, 4),
        other=event.other,
        from_s=_to_seconds(first),
        to_s=_to_seconds(last),
        reason="" if entry is None else entry.reason,
        confirmed_by="" if entry is None else entry.by,
    )


def _find_stretch(track: EgoTrack, event: InfractionEvent) -> tuple[int, int]:
    """Return the first and the last tick of an infraction, see `LoggedInfraction.from_s`."""
    if event.kind != OUTSIDE_LANES:
        return event.tick, event.tick
    longest = max(find_runs(find_infringing_ticks(track)), key=lambda run: run.stop - run.start)
    return longest.start, longest.stop - 1

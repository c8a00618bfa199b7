"""The recorded ending of a CAV, checked against its frames (protocol 5.2)."""

from mdrive_sumo.core.state import End, Kind
from mdrive_sumo.scoring.criteria import (
    RouteProgress,
    compute_completion_percent,
    compute_time_limit_ticks,
    find_end,
    update_progress,
)
from mdrive_sumo.scoring.metrics.collisions import INFRACTION_BY_KIND
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, EpisodeMismatch, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric
from mdrive_sumo.scoring.score_mode import ScoreMode

MARK_BY_END = {
    End.DEVIATED: "route-deviation",
    End.BLOCKED: "blocked",
    End.TIMED_OUT: "timed-out",
    End.AGENT_FAILED: "agent-failed",
}
LATE_KINDS = frozenset(MARK_BY_END[end] for end in (End.DEVIATED, End.BLOCKED, End.TIMED_OUT))
"""Marks of CAVs that do not arrive within their time limit although their agent works."""
LATE_FACTOR = 0.70
"""Penalty factor of such a mark in mode `hard`: that of the CARLA leaderboard 2.0 for a scenario that is not done in
time (`SCENARIO_TIMEOUT`). Blocked CAVs and those that leave their route have it too, so that neither ending is a way
round it."""

AGENT_FAILED_FACTOR = INFRACTION_BY_KIND[Kind.VEHICLE][1]
"""Penalty factor of an agent's failure, that of a collision with a vehicle: an agent that sees a collision coming must
not gain by ending its process. A deviation: the original ends the route with what it has."""


def find_ending_mark(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the mark of a CAV that did not arrive. Only an agent's failure has a penalty; its mark is at its tick."""
    return _mark_ending(track, 1.0)


def find_late_mark(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the mark of a CAV that did not arrive, with the penalty of mode `hard` (decision 097)."""
    return _mark_ending(track, LATE_FACTOR)


def _mark_ending(track: EgoTrack, late_factor: float) -> tuple[InfractionEvent, ...]:
    ending = track.ending
    kind = MARK_BY_END.get(ending.end)
    if kind is None:
        return ()
    if ending.failed_tick is not None:
        return (track.make_infraction(kind, ending.failed_tick, factor=AGENT_FAILED_FACTOR),)
    return (track.make_infraction(kind, ending.tick, factor=late_factor),)


def compute_route_completion(track: EgoTrack) -> float:
    """Return the route completion RC [%], 0 to 100 (protocol 6).

    Raises EpisodeMismatch if the criteria, applied to the recorded frames, end the CAV differently. No frame shows an
    agent's failure; the CAV must then end in the same tick as by the criteria, or earlier.
    """
    progress, reference = RouteProgress(), track.reference
    limit = compute_time_limit_ticks(track.scenario)[track.ego.id]
    end: End | None = None
    tick = -1
    for tick, ((x, y), speed) in enumerate(zip(track.xy.tolist(), track.speed.tolist(), strict=True)):
        progress = update_progress(progress, reference, tick, x, y, speed)
        end = find_end(progress, tick, limit)
        if end is not None:
            break
    recorded = (track.ending.end, track.ending.tick)
    failed_tick = track.ending.failed_tick
    if failed_tick is not None and (end is None or failed_tick < tick):
        end = End.AGENT_FAILED
    if recorded != (end, tick):
        raise EpisodeMismatch(
            f"episode of {track.episode.scenario}: CAV {track.ego.id} is recorded as {recorded[0]} in tick"
            f" {recorded[1]}, but its frames say {end or 'still driving'} in tick {tick}"
        )
    return compute_completion_percent(progress, reference)


ENDINGS = InfractionMetric("endings", find_ending_mark, frozenset(ScoreMode) - {ScoreMode.HARD})
LATE_ENDINGS = InfractionMetric("late_endings", find_late_mark, frozenset({ScoreMode.HARD}))

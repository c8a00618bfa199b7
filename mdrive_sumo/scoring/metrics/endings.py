"""The recorded ending of a CAV, checked against its frames (protocol 5.2)."""

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.criteria import (
    RouteProgress,
    compute_completion_percent,
    compute_time_limit_ticks,
    find_end,
    update_progress,
)
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, EpisodeMismatch
from mdrive_sumo.scoring.metrics.infraction import InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

MARK_BY_END = {
    End.DEVIATED: "route-deviation",
    End.BLOCKED: "blocked",
    End.TIMED_OUT: "timed-out",
    End.AGENT_FAILED: "agent-failed",
}


def find_ending_mark(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the mark, without a penalty, of a CAV that did not arrive."""
    kind = MARK_BY_END.get(track.ending.end)
    return (track.make_infraction(kind, track.ending.tick),) if kind else ()


def compute_route_completion(track: EgoTrack) -> float:
    """Return the route completion RC [%], 0 to 100 (protocol 6).

    Raises EpisodeMismatch if the criteria, applied to the recorded frames, end the CAV differently. Only an agent's
    failure cannot be checked: no frame shows it.
    """
    progress, reference, limit = RouteProgress(), track.reference, compute_time_limit_ticks(track.scenario)
    end: End | None = None
    tick = -1
    for tick, ((x, y), speed) in enumerate(zip(track.xy.tolist(), track.speed.tolist(), strict=True)):
        progress = update_progress(progress, reference, tick, x, y, speed)
        end = find_end(progress, tick, limit)
        if end is not None:
            break
    recorded = (track.ending.end, track.ending.tick)
    if recorded != (end or End.AGENT_FAILED, tick):
        raise EpisodeMismatch(
            f"episode of {track.episode.scenario}: CAV {track.ego.id} is recorded as {recorded[0]} in tick"
            f" {recorded[1]}, but its frames say {end or 'still driving'} in tick {tick}"
        )
    return compute_completion_percent(progress, reference)


ENDINGS = InfractionMetric("endings", find_ending_mark)

"""How a CAV ended: as recorded, and checked against what its frames say (protocol 5.2)."""

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.criteria import Trial, completion, observe, time_limit_ticks, verdict
from mdrive_sumo.scoring.metrics.ego_track import EpisodeMismatch, Track
from mdrive_sumo.scoring.metrics.infraction import Infraction

MARKS = {
    End.DEVIATED: "route-deviation",
    End.BLOCKED: "blocked",
    End.TIMED_OUT: "timed-out",
    End.AGENT_FAILED: "agent-failed",
}


def endings(track: Track) -> tuple[Infraction, ...]:
    """The mark, without a factor, of a CAV that did not arrive."""
    kind = MARKS.get(track.ending.end)
    return (track.event(kind, track.ending.tick),) if kind else ()


def route_completion(track: Track) -> float:
    """RC [%], 0 to 100 (protocol 6).

    Raises EpisodeMismatch if the criteria, applied to the recorded frames, end the CAV otherwise than
    recorded. Only the failure of an agent is taken on trust: no frame shows it.
    """
    trial, course, limit = Trial(), track.course, time_limit_ticks(track.scenario)
    end: End | None = None
    tick = -1
    for tick, ((x, y), speed) in enumerate(zip(track.xy.tolist(), track.speed.tolist(), strict=True)):
        trial = observe(trial, course, tick, x, y, speed)
        end = verdict(trial, tick, limit)
        if end is not None:
            break
    recorded = (track.ending.end, track.ending.tick)
    if recorded != (end or End.AGENT_FAILED, tick):
        raise EpisodeMismatch(
            f"episode of {track.episode.scenario}: CAV {track.ego.id} is recorded as {recorded[0]} in tick"
            f" {recorded[1]}, but its frames say {end or 'still driving'} in tick {tick}"
        )
    return completion(trial, course)

"""Impact speed of a collision, from recorded frames. For information only: no score depends on it."""

from mdrive_sumo.core import portable
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack


def compute_impact_speed(track: EgoTrack, tick: int, other: str) -> float:
    """Return the relative speed [m/s] of the CAV and another road user in the tick before their contact in `tick`.

    The frame of the contact itself is recorded after the impulse (decision 022). other: "" is a building, which stands.
    A road user that enters the world in the tick of the contact has its velocity of that tick.
    """
    before = max(tick - 1, 0)
    own = _compute_velocity(float(track.speed[before]), float(track.yaw[before]))
    episode = track.episode
    if other not in episode.ids:
        return portable.hypot(*own)
    column = episode.ids.index(other)
    at = before if episode.valid[before, column] else tick
    theirs = _compute_velocity(float(episode.speed[at, column]), float(episode.yaw[at, column]))
    return portable.hypot(own[0] - theirs[0], own[1] - theirs[1])


def _compute_velocity(speed: float, yaw: float) -> tuple[float, float]:
    return speed * portable.cos(yaw), speed * portable.sin(yaw)

"""Which samples of a drive teach something: those before the CAV failed."""

import numpy as np

from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics import EgoRecord

BEFORE_FAILURE_TICKS = 4 * TICKS_PER_SECOND
"""An expert that drives does wrong from so long before an infraction on: planners look 3 to 8 s ahead."""
MOVING_SPEED = 0.1
"""[m/s]"""
SHARE_OF_WAY = "outside-lanes"
"""An infraction without a time: it is noted at the end of the drive."""


def find_usable_end(record: EgoRecord, episode: EpisodeRecord, is_expert: bool) -> int:
    """Return the tick from which on samples of a CAV are left out.

    An expert that drives: 4 s before its first infraction, and when it moves for the last time if it does not arrive.
    A learner that drives: its first collision, because what the expert would do before is what it has to learn.
    """
    column = episode.ego_ids.index(record.id)
    events = [event for event in record.infractions if event.factor < 1.0 and event.kind != SHARE_OF_WAY]
    if not is_expert:
        collisions = [event.tick for event in events if event.kind.startswith("collision")]
        return min(collisions, default=record.ending.tick + 1)
    end = min((event.tick - BEFORE_FAILURE_TICKS for event in events), default=record.ending.tick + 1)
    if record.ending.end is not End.ARRIVED:
        moving = np.flatnonzero(np.abs(episode.speed[:, column]) > MOVING_SPEED)
        end = min(end, int(moving[-1]) if len(moving) else 0)
    return end

"""Pure readers of a finished episode: what each CAV completed, did wrong, came near to (protocol 6, 7)."""

from mdrive_sumo.scoring.metrics.ego_record import METRICS, EgoRecord, ego_records
from mdrive_sumo.scoring.metrics.ego_track import EpisodeMismatch
from mdrive_sumo.scoring.metrics.infraction import Infraction
from mdrive_sumo.scoring.metrics.min_ttc import min_ttc

__all__ = ["METRICS", "EgoRecord", "EpisodeMismatch", "Infraction", "ego_records", "min_ttc"]

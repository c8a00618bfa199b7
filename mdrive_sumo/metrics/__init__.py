"""Pure readers of a finished episode: what each CAV completed, did wrong, came near to (protocol 6, 7)."""

from mdrive_sumo.metrics.infraction import Infraction
from mdrive_sumo.metrics.min_ttc import min_ttc
from mdrive_sumo.metrics.record import METRICS, EgoRecord, ego_records
from mdrive_sumo.metrics.track import EpisodeMismatch

__all__ = ["METRICS", "EgoRecord", "EpisodeMismatch", "Infraction", "ego_records", "min_ttc"]

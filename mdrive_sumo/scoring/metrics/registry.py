"""The registry of metrics: to add one, write a file beside this one and add its metric to `METRICS`."""

from mdrive_sumo.scoring.metrics.collisions import COLLISIONS
from mdrive_sumo.scoring.metrics.comfort import COMFORT
from mdrive_sumo.scoring.metrics.endings import ENDINGS
from mdrive_sumo.scoring.metrics.lane_infractions import LANE_INFRACTIONS
from mdrive_sumo.scoring.metrics.mean_speed import MEAN_SPEED
from mdrive_sumo.scoring.metrics.message_rate import MESSAGE_RATE
from mdrive_sumo.scoring.metrics.metric import InfractionMetric, ScalarMetric
from mdrive_sumo.scoring.metrics.min_pet import MIN_PET
from mdrive_sumo.scoring.metrics.min_ttc import MIN_TTC
from mdrive_sumo.scoring.metrics.red_lights import RED_LIGHTS
from mdrive_sumo.scoring.metrics.stop_signs import STOP_SIGNS

METRICS: tuple[InfractionMetric | ScalarMetric, ...] = (
    COLLISIONS,
    RED_LIGHTS,
    STOP_SIGNS,
    LANE_INFRACTIONS,
    ENDINGS,
    MIN_TTC,
    MIN_PET,
    MEAN_SPEED,
    COMFORT,
    MESSAGE_RATE,
)


def list_infraction_metrics() -> tuple[InfractionMetric, ...]:
    """Return the infraction metrics; infractions of one tick are listed in their order."""
    return tuple(metric for metric in METRICS if isinstance(metric, InfractionMetric))


def list_scalar_metrics() -> tuple[ScalarMetric, ...]:
    """Return the scalar metrics, in the order of their columns."""
    return tuple(metric for metric in METRICS if isinstance(metric, ScalarMetric))

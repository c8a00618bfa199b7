"""The registry of metrics: the built-in ones, and those of other packages (docs/how-to/add-a-metric.md)."""

from functools import lru_cache

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugInKind, check_plug_in_names, list_plug_ins
from mdrive_sumo.scoring.metrics.collisions import COLLISIONS
from mdrive_sumo.scoring.metrics.comfort import COMFORT
from mdrive_sumo.scoring.metrics.endings import ENDINGS, LATE_ENDINGS
from mdrive_sumo.scoring.metrics.lane_infractions import LANE_INFRACTIONS
from mdrive_sumo.scoring.metrics.mean_speed import MEAN_SPEED
from mdrive_sumo.scoring.metrics.message_rate import MESSAGE_RATE
from mdrive_sumo.scoring.metrics.metric import InfractionMetric, ScalarMetric
from mdrive_sumo.scoring.metrics.min_pet import MIN_PET
from mdrive_sumo.scoring.metrics.min_ttc import MIN_TTC
from mdrive_sumo.scoring.metrics.red_lights import RED_LIGHTS
from mdrive_sumo.scoring.metrics.speeding import SPEED_LIMITS, SPEEDING
from mdrive_sumo.scoring.metrics.stop_signs import STOP_SIGNS

METRICS: tuple[InfractionMetric | ScalarMetric, ...] = (
    COLLISIONS,
    RED_LIGHTS,
    STOP_SIGNS,
    LANE_INFRACTIONS,
    SPEED_LIMITS,
    ENDINGS,
    LATE_ENDINGS,
    MIN_TTC,
    MIN_PET,
    MEAN_SPEED,
    COMFORT,
    MESSAGE_RATE,
    SPEEDING,
)


def list_infraction_metrics() -> tuple[InfractionMetric, ...]:
    """Return the infraction metrics; infractions of one tick are listed in their order."""
    return tuple(metric for metric in _list_metrics() if isinstance(metric, InfractionMetric))


def list_scalar_metrics() -> tuple[ScalarMetric, ...]:
    """Return the scalar metrics, in the order of their columns."""
    return tuple(metric for metric in _list_metrics() if isinstance(metric, ScalarMetric))


def _list_metrics() -> tuple[InfractionMetric | ScalarMetric, ...]:
    return (*METRICS, *load_metric_plug_ins())


@lru_cache(maxsize=1)
def load_metric_plug_ins() -> tuple[InfractionMetric | ScalarMetric, ...]:
    """Return the metrics of other packages, sorted by name. Raises InputError for one that is none."""
    check_plug_in_names(PlugInKind.METRICS, (metric.name for metric in METRICS))
    return tuple(_load_metric(name) for name in list_plug_ins(PlugInKind.METRICS))


def _load_metric(name: str) -> InfractionMetric | ScalarMetric:
    plug_in = list_plug_ins(PlugInKind.METRICS)[name]
    metric = plug_in.load()
    if not isinstance(metric, InfractionMetric | ScalarMetric) or metric.name != name:
        raise InputError(
            f"{plug_in.describe()}: expected a ScalarMetric or InfractionMetric with the name {name!r}, found"
            f" {metric!r:.80}"
        )
    return metric

"""What stations receive of each other, with shadowing, and of connected background vehicles, in the median."""

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.v2x.radio.path_loss import (
    SHADOWING_DB,
    SOURCE_SIGMA_DB,
    Classes,
    LinkClass,
    LossFormulas,
    compute_blockage_mean,
    compute_path_loss,
    find_blockage_sigma,
)
from mdrive_sumo.v2x.radio.shadowing import evaluate_field


@twin
def compute_received_power(
    xy: Float,
    height: Float,
    classes: Classes,
    blocker: Float,
    corner_db: Float | None,
    formulas: LossFormulas,
    shadowing: Float,
    blockage: Float,
    sent_dbm: float,
    /,
) -> Float:
    """Return the received power (n, n + m) [dBm] of n stations from each other and from m background vehicles.

    xy, height, classes, blocker, corner_db: as `RadioScene`. shadowing, blockage: waves (WAVES, 5) of the fields of
    both, which count among stations only. sent_dbm: transmit power and the gains of both antennas. The diagonal has
    that level, for which nothing asks.
    """
    n, total = classes.shape
    power = np.full((n, total), float(sent_dbm))
    first, second = np.triu_indices(n, 1)
    losses = _compute_medians(xy, height, classes, formulas, first, second)
    sigma = SHADOWING_DB[classes[first, second]]
    if corner_db is not None:
        around = corner_db[first, second]
        is_corner = np.isfinite(around)
        free = _compute_medians(xy, height, np.full_like(classes, LinkClass.LOS), formulas, first, second)
        losses = np.where(is_corner, np.maximum(np.where(is_corner, around, 0.0), free), losses)
        sigma = np.where(is_corner, SOURCE_SIGMA_DB, sigma)
    losses = losses + sigma * evaluate_field(shadowing, xy[first], xy[second])
    losses = losses + _compute_blockage(xy, height, classes, blocker, blockage, first, second)
    power[first, second] = power[second, first] = sent_dbm - losses
    rows, columns = np.divmod(np.arange(n * (total - n)), max(total - n, 1))
    losses = _compute_medians(xy, height, classes, formulas, rows, columns + n)
    losses = losses + _compute_blockage(xy, height, classes, blocker, None, rows, columns + n)
    power[:, n:] = (sent_dbm - losses).reshape(n, -1)
    return power


def _measure_distances(xy: Float, height: Float, first: Int, second: Int) -> Float:
    apart, across = xy[first] - xy[second], height[first] - height[second]
    return np.sqrt(apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1] + across * across)


def _compute_medians(
    xy: Float, height: Float, classes: Classes, formulas: LossFormulas, first: Int, second: Int
) -> Float:
    """Return the median losses (P,) [dB] of pairs, without those of vehicles in between."""
    return compute_path_loss(formulas, classes[first, second], _measure_distances(xy, height, first, second))


def _compute_blockage(
    xy: Float, height: Float, classes: Classes, blocker: Float, waves: Float | None, first: Int, second: Int
) -> Float:
    """Return what vehicles in between add to the losses (P,) [dB] of pairs: without waves in the mean."""
    losses = np.zeros(len(first))
    blocked = np.flatnonzero(classes[first, second] == LinkClass.NLOSV)
    first, second = first[blocked], second[blocked]
    ends = height[first], height[second]
    heights = np.minimum(*ends), np.maximum(*ends), blocker[first, second]
    mean = compute_blockage_mean(_measure_distances(xy, height, first, second), *heights)
    if waves is not None:
        deviation = evaluate_field(waves, xy[first], xy[second])
        mean = np.maximum(mean + find_blockage_sigma(*heights) * deviation, 0.0)
    losses[blocked] = mean
    return losses

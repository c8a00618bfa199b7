"""A likelihood-based realism score of simulated traffic, as the Waymo Open Sim Agents Challenge defines it.

Montali et al., "The Waymo Open Sim Agents Challenge", NeurIPS 2023 (arXiv 2305.12032): how likely is what the log did
under the distribution of what the simulation does? For every feature, the values of all rollouts of a road user make a
histogram; the score of the feature is the geometric mean of the probabilities of the logged values. The realism score
is the weighted mean over the features. Ranges, bins, pseudo counts and weights are those of the challenge of 2025
(`challenge_2025_sim_agents_config.textproto`); its off-road and traffic-light features are left out, because the
networks of logs have neither road edges nor lights, and the weights of the others are scaled to a sum of 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int

PSEUDOCOUNT = 0.1
"""Added to the count of every bin, so that nothing has the probability 0."""
INDICATOR_PSEUDOCOUNT = 0.001
"""Added to the counts of both outcomes of a yes or no: chosen, so that what never happens in few rollouts is rare."""


@dataclass(frozen=True, slots=True)
class RealismFeature:
    """A feature of `compute_features`, its histogram, and its weight in the realism score."""

    name: str
    title: str
    low: float
    high: float
    bins: int
    weight: float

    def find_bins(self, values: Float) -> Int:
        """Return the indices of the bins of values (any shape); what lies beyond the range is in the outermost bin."""
        share = (np.clip(values, self.low, self.high) - self.low) / (self.high - self.low)
        return np.asarray(np.minimum(share * self.bins, self.bins - 1), dtype=np.int64)


FEATURES = (
    RealismFeature("speed", "speed", 0.0, 25.0, 10, 0.05),
    RealismFeature("acceleration", "acceleration", -12.0, 12.0, 11, 0.05),
    RealismFeature("turn_rate", "turn rate", -0.628, 0.628, 11, 0.05),
    RealismFeature("turn_acceleration", "turn acceleration", -3.14, 3.14, 11, 0.05),
    RealismFeature("nearest", "nearest road user", -5.0, 40.0, 10, 0.10),
    RealismFeature("ttc", "time to collision", 0.0, 5.0, 10, 0.10),
    RealismFeature("lateral_offset", "lateral offset", 0.0, 4.0, 10, 0.05),
    RealismFeature("gap", "gap ahead", 0.0, 40.0, 10, 0.0),
)
"""The lateral offset stands for the challenge's distance to the road's edge and has its weight; the range is ours. The
gap ahead is no feature of the challenge: it is shown, and has no weight."""
COLLISIONS = "collisions"
COLLISION_WEIGHT = 0.25
MEASURES = (*(feature.name for feature in FEATURES), COLLISIONS)


@dataclass(frozen=True)
class RealismSamples:
    """Samples (T, E) of every feature by name, and whether each road user (E,) collides."""

    features: Mapping[str, Float]
    collides: Bool


def compute_likelihoods(log: RealismSamples, rollouts: Sequence[RealismSamples]) -> dict[str, float]:
    """Return the likelihood in (0, 1] of a log under rollouts of the same road users, by measure.

    Every road user has a histogram of its own. A measure of which the log has no sample is left out.
    """
    scores: dict[str, float] = {}
    for feature in FEATURES:
        logged = log.features[feature.name]
        simulated = np.concatenate([one.features[feature.name] for one in rollouts])
        logs = [
            np.log(_look_up(feature, _estimate_shares(feature, simulated[:, k]), logged[:, k]))
            for k in range(logged.shape[1])
        ]
        if len(together := np.concatenate([*logs, np.zeros(0)])):
            scores[feature.name] = float(np.exp(together.mean()))
    if len(log.collides):
        hits = np.array([one.collides for one in rollouts]).sum(axis=0) + INDICATOR_PSEUDOCOUNT
        share = hits / (len(rollouts) + 2 * INDICATOR_PSEUDOCOUNT)
        scores[COLLISIONS] = float(np.exp(np.log(np.where(log.collides, share, 1 - share)).mean()))
    return scores


def compute_pooled_likelihoods(log: RealismSamples, population: Sequence[RealismSamples]) -> dict[str, float]:
    """Return the likelihood of a log under one histogram of a whole population, by measure.

    The population need not be of the same road users, nor of the same place.
    """
    scores: dict[str, float] = {}
    for feature in FEATURES:
        logged = log.features[feature.name].ravel()
        pooled = np.concatenate([one.features[feature.name].ravel() for one in population])
        shares = _look_up(feature, _estimate_shares(feature, pooled), logged)
        if len(shares):
            scores[feature.name] = float(np.exp(np.log(shares).mean()))
    if len(log.collides):
        collides = np.concatenate([one.collides for one in population])
        share = (collides.sum() + INDICATOR_PSEUDOCOUNT) / (len(collides) + 2 * INDICATOR_PSEUDOCOUNT)
        scores[COLLISIONS] = float(np.exp(np.log(np.where(log.collides, share, 1 - share)).mean()))
    return scores


def compute_realism(likelihoods: Mapping[str, float]) -> float:
    """Return the realism score in (0, 1]: the weighted mean of the likelihoods that there are."""
    weights = {feature.name: feature.weight for feature in FEATURES} | {COLLISIONS: COLLISION_WEIGHT}
    total = sum(weights[name] for name in likelihoods)
    return sum(weights[name] * value for name, value in likelihoods.items()) / total


def _estimate_shares(feature: RealismFeature, values: Float) -> Float:
    """Return the probability of every bin by the values that are there."""
    counts = np.bincount(feature.find_bins(values[np.isfinite(values)]), minlength=feature.bins) + PSEUDOCOUNT
    return np.asarray(counts / counts.sum())


def _look_up(feature: RealismFeature, shares: Float, values: Float) -> Float:
    """Return the probability of every value that is there."""
    return shares[feature.find_bins(values[np.isfinite(values)])]

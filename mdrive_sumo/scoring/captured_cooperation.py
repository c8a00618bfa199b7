"""Captured cooperation: the share of the gain of perfect cooperation that an agent reaches over its channel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring.category_groups import compute_category_group_means
from mdrive_sumo.scoring.results import Means, Results, ScenarioResult
from mdrive_sumo.scoring.score_mode import ScoreMode
from mdrive_sumo.scoring.summary import compute_bucket_means, compute_category_means, compute_overall

LEAST_GAIN_DS = 2.0
"""Least gain of perfect cooperation [DS]: the share of a smaller gain would be noise and is left blank."""


@dataclass(frozen=True, slots=True)
class CapturedCooperation:
    """Captured cooperation as a share (docs/studies.md); None where perfect cooperation gains less than 2 DS."""

    bucket_mean: float | None
    scenario_mean: float | None
    buckets: Mapping[str, float | None]
    categories: Mapping[str, float | None]
    """InterDrive's groups included."""


def compute_captured_cooperation(agent: Results, off: Results, omniscient: Results) -> CapturedCooperation:
    """(agent - off) / (omniscient - off) on mean DS, over the scenarios that are void in none of the three runs.

    off: the same agent with the channel switched off. Raises InputError for runs that do not belong together.
    """
    for other in (off, omniscient):
        for name in ("suite_checksum", "score_mode"):
            ours, theirs = getattr(agent.run, name), getattr(other.run, name)
            if ours != theirs:
                raise InputError(
                    f"captured cooperation: expected runs of one {name.replace('_', ' ')}, found {ours} and {theirs}"
                )
    mode = ScoreMode(agent.run.score_mode)
    return compute_captured_from_scenarios(agent.scenarios, off.scenarios, omniscient.scenarios, mode)


def compute_captured_from_scenarios(
    agent: Sequence[ScenarioResult],
    off: Sequence[ScenarioResult],
    omniscient: Sequence[ScenarioResult],
    mode: ScoreMode,
) -> CapturedCooperation:
    """As `captured`, of scenarios from any number of seeds. Raises InputError if they have none in common."""
    runs = [{(s.id, s.seed): s for s in run if s.status == "ok"} for run in (agent, off, omniscient)]
    common = [key for key in runs[0] if all(key in run for run in runs)]
    if not common:
        raise InputError(
            "captured cooperation: expected scenarios that all three runs have and none is void in, found none"
        )
    ours, without, best = ([run[key] for key in common] for run in runs)

    def group_means(scenarios: Sequence[ScenarioResult]) -> Mapping[str, Means]:
        return compute_category_means(scenarios) | compute_category_group_means(scenarios, mode)

    totals = [compute_overall(scenarios) for scenarios in (ours, without, best)]
    return CapturedCooperation(
        bucket_mean=compute_captured_share(*(total.bucket_mean.ds for total in totals)),
        scenario_mean=compute_captured_share(*(total.scenario_mean.ds for total in totals)),
        buckets=_compute_shares(compute_bucket_means(ours), compute_bucket_means(without), compute_bucket_means(best)),
        categories=_compute_shares(group_means(ours), group_means(without), group_means(best)),
    )


def compute_captured_share(agent: float, off: float, omniscient: float) -> float | None:
    """Return the agent's share of omniscient's gain [DS]; None if that gain is below `LEAST_GAIN_DS`."""
    gain = omniscient - off
    return (agent - off) / gain if gain >= LEAST_GAIN_DS else None


def _compute_shares(
    agent: Mapping[str, Means], off: Mapping[str, Means], omniscient: Mapping[str, Means]
) -> dict[str, float | None]:
    return {name: compute_captured_share(agent[name].ds, off[name].ds, omniscient[name].ds) for name in agent}

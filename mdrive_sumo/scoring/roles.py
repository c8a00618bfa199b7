"""Scores by agent in runs of two agents: the CAVs under test, and the others (cross-play, partial penetration)."""

from collections.abc import Callable, Collection, Sequence

from mdrive_sumo.scoring.results import EgoResult, RoleMeans, Roles, ScenarioResult
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, compute_mean


def mark_tested(result: ScenarioResult, tested: Collection[str]) -> ScenarioResult:
    """Return the result with every CAV marked that the agent under test did not drive. tested: ids of CAVs."""
    egos = tuple(ego.model_copy(update={"is_other": ego.id not in tested}) for ego in result.egos)
    return result.model_copy(update={"egos": egos})


def compute_roles(scenarios: Sequence[ScenarioResult]) -> Roles | None:
    """Return the scores of both agents; None unless a second agent drove a CAV.

    Each scenario has the same weight. Void scenarios name no CAVs and count as 0, as in all other means.
    """
    if not any(ego.is_other for scenario in scenarios for ego in scenario.egos):
        return None
    tested = _average(scenarios, lambda ego: not ego.is_other)
    assert tested is not None, "every scenario has a CAV under test"
    return Roles(tested=tested, others=_average(scenarios, lambda ego: ego.is_other))


def _average(scenarios: Sequence[ScenarioResult], is_meant: Callable[[EgoResult], bool]) -> RoleMeans | None:
    groups = [[ego for ego in scenario.egos if is_meant(ego)] for scenario in scenarios]
    kept = [group for group, scenario in zip(groups, scenarios, strict=True) if group or scenario.status == "void"]
    egos = [ego for group in kept for ego in group]
    if not egos:
        return None
    ratios = [ego.time_ratio for ego in egos if ego.time_ratio is not None]
    return RoleMeans(
        cavs=len(egos),
        ds=_average_groups(kept, lambda ego: ego.ds),
        sr=_average_groups(kept, lambda ego: 100.0 * (ego.ds > SUCCESS_DS)),
        rc=_average_groups(kept, lambda ego: ego.rc),
        ip=_average_groups(kept, lambda ego: ego.ip),
        time_ratio=compute_mean(ratios) if ratios else None,
    )


def _average_groups(groups: Sequence[Sequence[EgoResult]], value: Callable[[EgoResult], float]) -> float:
    return compute_mean(compute_mean(map(value, group)) if group else 0.0 for group in groups)

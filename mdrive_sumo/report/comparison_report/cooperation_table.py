"""Captured cooperation of the agents whose references are among the runs of a report."""

from collections.abc import Sequence

from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import (
    BestValue,
    Column,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.published_results import order_buckets
from mdrive_sumo.report.result_tables import list_percent
from mdrive_sumo.runs.setting_differences import LIBRARY_CODE, compare_settings
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation, compute_captured_from_scenarios

OMNISCIENT = "omniscient"
COOPERATION_NOTE = (
    "(agent - the same agent with the channel off) / (omniscient - the same agent with the channel off) on mean DS, in"
    " percent: 0 is driving alone, 100 perfect cooperation; - where perfect cooperation gains less than 2 DS."
    " Scenarios and seeds that all three have and none is void in."
)
OWN_SETTINGS = ("agent", "agent code", "agent config", "agent clock", "sandbox", "comm ", LIBRARY_CODE)
"""Beginnings of the names of settings in which the reference `omniscient` may differ."""


def compute_captured(agents: Sequence[ComparedAgent]) -> dict[str, CapturedCooperation]:
    """Return the captured cooperation of every agent that has both references among the others, by name."""
    captured_by_agent: dict[str, CapturedCooperation] = {}
    for agent in agents:
        off, best = _find_channel_off(agent, agents), _find_omniscient(agent, agents)
        if off is None or best is None:
            continue
        mode = ScoreMode(agent.results.run.score_mode)
        try:
            captured_by_agent[agent.name] = compute_captured_from_scenarios(
                agent.results.scenarios, off.results.scenarios, best.results.scenarios, mode
            )
        except InputError:  # no scenario and seed in common: there is no share
            continue
    return captured_by_agent


def build_cooperation_table(agents: Sequence[ComparedAgent], name: str = "cooperation") -> Table | None:
    """Return captured cooperation by bucket and overall; None if no agent has its references among the runs."""
    captured = compute_captured(agents)
    if not captured:
        return None
    buckets = order_buckets(agents[0].results.buckets)
    columns = [Column("agent", "Agent")]
    columns += [Column(bucket, bucket, decimals=1, best=BestValue.HIGHEST) for bucket in buckets]
    columns += [
        Column("bucket_mean", "bucket mean", decimals=1, best=BestValue.HIGHEST),
        Column("scenario_mean", "scenario mean", decimals=1, best=BestValue.HIGHEST),
    ]
    group_by_name = {agent.name: agent.rank_group for agent in agents}
    rows = [
        make_row(
            (
                name,
                *list_percent((*(share.buckets.get(b) for b in buckets), share.bucket_mean, share.scenario_mean)),
            ),
            rank_group=group_by_name[name],
        )
        for name, share in captured.items()
    ]
    return Table(name, "Captured cooperation [%]", tuple(columns), tuple(rows), COOPERATION_NOTE).mark_columns()


def _find_channel_off(agent: ComparedAgent, agents: Sequence[ComparedAgent]) -> ComparedAgent | None:
    """Return the same agent with the channel off; None for an agent that is driven so itself."""
    if not _has_channel(agent):
        return None
    return next(
        (other for other in agents if not _has_channel(other) and _differs_only(agent, other, ("comm ", LIBRARY_CODE))),
        None,
    )


def _find_omniscient(agent: ComparedAgent, agents: Sequence[ComparedAgent]) -> ComparedAgent | None:
    return next(
        (
            other
            for other in agents
            if other.results.run.agent == OMNISCIENT
            and other.results.run.agent_clock == IDEAL.text
            and _differs_only(agent, other, OWN_SETTINGS)
        ),
        None,
    )


def _has_channel(agent: ComparedAgent) -> bool:
    return bool(agent.results.run.comm.get("on", True))


def _differs_only(agent: ComparedAgent, other: ComparedAgent, names: tuple[str, ...]) -> bool:
    """Return whether two agents have the same settings but for those whose names begin with one of `names`."""
    differences = compare_settings(agent.runs[0].settings, other.runs[0].settings)
    return all(difference.name.startswith(names) for difference in differences)

"""The ranking of a report by item response, beside its means."""

from collections.abc import Sequence

from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.core.tables import Cell, Column, IntervalStyle, Row, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import UPPER_BOUND, ComparedAgent
from mdrive_sumo.report.comparison_report.drive_conditions import find_differing_conditions
from mdrive_sumo.scoring.item_response import LEAST_AGENTS, RankedAgent, rank_agents

RANKING_NOTE = (
    "Ability: the driving score that is expected in a scenario of mean difficulty, from a joint fit of all agents and"
    " scenarios (beta-3 item response, docs/scoring.md). A rank is 1 + the number of agents that are clearly abler, so"
    " agents that are not told apart are tied; tracks and conditions are ranked apart. Intervals: 95 %, places drawn"
    " anew, then scenarios, then seeds."
)
NEEDS_AGENTS = f"A ranking by item response needs runs of at least {LEAST_AGENTS} agents with common seeds."


def build_ranking_table(agents: Sequence[ComparedAgent], name: str = "ranking") -> Table | None:
    """Return the agents, the ablest first; None for too few agents, or without a seed that all of them have."""
    scores = {
        agent.name: {one.label: one.ds for one in agent.results.scenarios if one.status == "ok"} for agent in agents
    }
    if len(agents) < LEAST_AGENTS or not set.intersection(*(set(table) for table in scores.values())):
        return None
    groups = {agent.name: agent.rank_group if agent.is_ranked else None for agent in agents}
    ranking = rank_agents(scores, groups)
    has_ends = any(one.low is not None for one in ranking.agents)
    missing = "" if has_ends else f" Too few places for intervals ({ranking.places}): ranks go by the ability alone."
    sections = _name_sections(agents)
    rows = [(sections[one.agent], one) for one in ranking.agents]
    order = [*dict.fromkeys(sections.values())]
    return Table(
        name,
        "Ranking by item response",
        (
            Column("agent", "Agent"),
            Column("rank", "rank", decimals=0),
            Column("rank_interval", "95 % of ranks"),
            Column("ability", "ability", decimals=1, intervals=IntervalStyle.ENDS),
            Column("ds", "mean DS", decimals=1),
        ),
        tuple(
            _make_row(one, ranking.places, section)
            for section, one in sorted(rows, key=lambda row: order.index(row[0]))
        ),
        RANKING_NOTE + missing,
    )


def _name_sections(agents: Sequence[ComparedAgent]) -> dict[str, str]:
    """Return the heading of each agent's row, one for all that are ranked together; "" if all of them are."""
    ranked = [agent for agent in agents if agent.is_ranked]
    differing = find_differing_conditions([agent.conditions for agent in ranked])
    if len({agent.rank_group if agent.is_ranked else None for agent in agents}) == 1:
        return {agent.name: "" for agent in agents}
    return {
        agent.name: ", ".join((f"{agent.track or 'object'} track".capitalize(), *agent.conditions.format(differing)))
        if agent.is_ranked
        else UPPER_BOUND
        for agent in agents
    }


def _make_row(one: RankedAgent, places: int, section: str) -> Row:
    ends = "-" if one.rank_low is None else f"{one.rank_low} to {one.rank_high}"
    interval = ConfidenceInterval(one.ability, one.low, one.high, places)
    rank = None if one.rank is None else float(one.rank)
    return make_row((one.agent, rank, ends, Cell(one.ability, interval), one.mean), section)

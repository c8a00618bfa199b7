"""How drives ended and which infractions were committed, per CAV, so that runs of any number of seeds compare."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from mdrive_sumo.core.tables import Column, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.result_tables import count_collisions_by_severity, count_infractions, count_outcomes
from mdrive_sumo.scoring import Results

PER_DRIVES = 100
"""Infractions are counted per so many drives of a CAV."""
OUTCOME_NOTE = "Percent of the drives of all CAVs in all episodes; void episodes have none and are counted apart."
INFRACTION_NOTE = (
    f"Infractions that cost score, per {PER_DRIVES} drives of a CAV. Impact speeds: relative speed of a collision in"
    " the tick before the contact."
)


def count_drives(results: Results) -> int:
    """Return the number of CAVs, summed over all episodes that are not void."""
    return sum(len(scenario.egos) for scenario in results.scenarios)


def build_outcome_table(agents: Sequence[ComparedAgent], name: str = "outcomes") -> Table:
    """Return how the drives ended, in percent."""
    return _build_share_table(agents, count_outcomes, name, "Outcomes", OUTCOME_NOTE, with_void=True)


def build_infraction_table(agents: Sequence[ComparedAgent], name: str = "infractions") -> Table:
    """Return the infractions by kind, and the collisions by impact speed, per 100 drives."""

    def count(results: Results) -> Mapping[str, int]:
        severities = count_collisions_by_severity(results)
        return {**count_infractions(results), **{f"{SEVERITY_GROUP}: {kind}": n for kind, n in severities.items()}}

    return _build_share_table(agents, count, name, "Infractions", INFRACTION_NOTE, with_void=False)


SEVERITY_GROUP = "impact"


def _build_share_table(
    agents: Sequence[ComparedAgent],
    count: Callable[[Results], Mapping[str, int]],
    name: str,
    title: str,
    note: str,
    *,
    with_void: bool,
) -> Table:
    counts = [Counter(count(agent.results)) for agent in agents]
    kinds = _order_kinds(counts)
    columns = [Column("agent", "Agent"), Column("drives", "drives", decimals=0)]
    columns += [Column(kind, _shorten(kind), _find_group(kind)) for kind in kinds]
    columns += [Column("void", "void episodes", decimals=0)] if with_void else []
    rows = [
        make_row(
            (
                agent.name,
                float(drives := count_drives(agent.results)),
                *(PER_DRIVES * found[kind] / drives if drives else None for kind in kinds),
                *((float(agent.results.void),) if with_void else ()),
            ),
            agent.section,
        )
        for agent, found in zip(agents, counts, strict=True)
    ]
    empty = "" if kinds else " There were none."
    return Table(name, title, tuple(columns), tuple(rows), note + empty)


def _order_kinds(counts: Sequence[Counter[str]]) -> list[str]:
    """Return all kinds, the most frequent first, severities last in their own order."""
    total: Counter[str] = sum(counts, Counter())
    severities = list(dict.fromkeys(kind for found in counts for kind in found if _find_group(kind)))
    others = sorted((kind for kind in total if not _find_group(kind)), key=lambda kind: (-total[kind], kind))
    return [*others, *severities]


def _find_group(kind: str) -> str:
    return "impact speed" if kind.startswith(f"{SEVERITY_GROUP}: ") else ""


def _shorten(kind: str) -> str:
    return kind.removeprefix(f"{SEVERITY_GROUP}: ")

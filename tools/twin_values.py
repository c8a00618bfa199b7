"""The table of `study twins` from values: the scores that are compared, each factor and its originals as a part."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.tables import format_markdown
from mdrive_sumo.scoring import Results, summarize_run
from mdrive_sumo.study.study_files import count_by_chance
from mdrive_sumo.study.twin_scenarios import TwinFactor
from mdrive_sumo.study.twins import ORIGINAL, TwinLine, TwinRow, TwinSummary, compare_pairs, pair_twins
from mdrive_sumo.study.twins_files import build_twins_table
from tools.published_values import Values, find_compared_agent


def pair_runs(parts: Mapping[str, Sequence[Results]]) -> Values:
    """Return the scores that a study of twins compares, of its runs by the name of their folder: `PART`."""
    rows = [
        TwinRow(find_compared_agent(results.run), None if part == ORIGINAL else TwinFactor(part), (results,))
        for part, found in parts.items()
        for results in found
    ]
    infos = {(row.agent, row.factor): row.results[0].run for row in rows}
    values: dict[str, list[Results]] = {}
    for (agent, factor), pairs in pair_twins(rows).items():
        bases, twins = zip(*pairs, strict=True)
        values.setdefault(_name_originals(factor), []).append(summarize_run(infos[agent, None], bases))
        values.setdefault(factor.value, []).append(summarize_run(infos[agent, factor], twins))
    return values


def _name_originals(factor: TwinFactor) -> str:
    return f"{factor}, {ORIGINAL}"


def list_originals(values: Values) -> Sequence[Results]:
    """Return the runs that twins are compared with, factor by factor."""
    return [one for factor in TwinFactor for one in values.get(_name_originals(factor), ())]


def list_twins(values: Values) -> Sequence[str]:
    """Return the paragraphs of the table."""
    lines: list[TwinLine] = []
    for factor in (one for one in TwinFactor if one in values):
        originals = {results.run.agent: results for results in values[_name_originals(factor)]}
        for twin in values[factor]:
            agent = find_compared_agent(twin.run)
            pairs = zip(originals[agent].scenarios, twin.scenarios, strict=True)
            lines.append(compare_pairs(agent, factor, [*pairs]))
    summary = TwinSummary(tuple(sorted(lines, key=lambda line: line.agent)), gaps=(), void=0)
    return format_markdown(build_twins_table(summary)), count_by_chance(line.change for line in lines)

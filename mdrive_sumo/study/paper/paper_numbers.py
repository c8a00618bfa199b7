"""All numbers of the study, computed from its runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent, make_agents_of_results
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.cooperation_gain import (
    LEARNED_PAIRS,
    PairGain,
    RoleGap,
    compute_pair_gains,
    compute_role_gaps,
    split_learned_gap,
)
from mdrive_sumo.study.paper.detector_order import (
    Precisions,
    correlate_open_precision,
    correlate_precisions,
    select_detectors,
)
from mdrive_sumo.study.paper.open_closed import OpenClosedComparison, RankCorrelation, compare_open_with_closed
from mdrive_sumo.study.paper.paper_plan import PaperPlan
from mdrive_sumo.study.paper.paper_study import (
    ClosedRow,
    OpenRow,
    PaperRow,
    PaperStudy,
    is_surrogate,
    select_results,
)
from mdrive_sumo.study.study_runs import StudyRow


@dataclass(frozen=True, slots=True)
class PaperNumbers:
    """The numbers of the study."""

    plan: PaperPlan
    scenarios: tuple[Scenario, ...]
    """The scenarios of the main table."""
    closed: Mapping[str, Results]
    """By agent; surrogates of detectors have the scenarios of the open loop only."""
    open: Mapping[str, OpenLoopResults]
    channel: tuple[StudyRow, ...]
    compared: tuple[ComparedAgent, ...]
    """The agents of the main table, in its order."""
    gaps: tuple[RoleGap, ...]
    learned_gaps: tuple[RoleGap, ...]
    gains: tuple[PairGain, ...]
    learned_gains: tuple[PairGain, ...]
    comparison: OpenClosedComparison
    precisions: Precisions
    detectors: Mapping[str, Results]
    """`perception-swap:*` by detector, over the scenarios of both loops."""
    precision_correlations: tuple[RankCorrelation, ...]

    @property
    def runs(self) -> tuple[Results, ...]:
        """The results of all runs in closed loop, those over worse channels included."""
        return (*self.closed.values(), *(results for row in self.channel for results in row.results))


def compute_paper_numbers(
    study: PaperStudy, rows: Sequence[PaperRow], precisions: Precisions = MappingProxyType({})
) -> PaperNumbers:
    """Return the numbers of a finished study, which has an agent for the main table. precisions: of test frames."""
    closed = {row.agent: row for row in rows if isinstance(row, ClosedRow) and row.agent in study.agents}
    opened = {row.agent: row.results for row in rows if isinstance(row, OpenRow)}
    main = [row for name, row in closed.items() if not is_surrogate(name)]
    driven = {row.agent: row.results for row in main}
    results = {name: row.results for name, row in closed.items()}
    detectors = select_detectors({name: select_results(run, study.plan.logs) for name, run in results.items()})
    return PaperNumbers(
        study.plan,
        tuple(scenario for scenario in study.reference.scenarios if scenario.id in {*study.plan.closed}),
        results,
        opened,
        tuple(row for row in rows if isinstance(row, StudyRow)),
        make_agents_of_results([row.results for row in main], [row.folder for row in main]),
        compute_role_gaps(driven),
        split_learned_gap(driven),
        compute_pair_gains(driven),
        compute_pair_gains(driven, LEARNED_PAIRS),
        compare_open_with_closed(opened, results),
        precisions,
        detectors,
        (*correlate_precisions(detectors, precisions), *correlate_open_precision(opened, results)),
    )

"""RQ3 from runs of `eval` and a `detectors.json`: the order of detectors in precision beside that in drives."""

from collections.abc import Sequence

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_markdown
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary
from mdrive_sumo.learning.fusion.detectors_file import list_compared
from mdrive_sumo.report.comparison_report.compared_agent import pool_results
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.detector_order import (
    BASE,
    build_detector_table,
    build_precision_correlations,
    correlate_precisions,
)
from mdrive_sumo.study.paper.open_closed import MIN_AGENTS
from mdrive_sumo.study.paper.paper_study import DETECTOR_PREFIX


def list_detector_order(runs: Sequence[Results], summary: DetectorSummary) -> Sequence[str]:
    """Return the paragraphs of RQ3: precision beside DS and SR of the agents that drive with the detectors.

    Raises InputError for runs that are not of three measured detectors or more, `none` among them.
    """
    by_detector = {
        name: pool_results(found)
        for name in summary.precisions
        if (found := [results for results in runs if results.run.agent == f"{DETECTOR_PREFIX}{name}"])
    }
    if len(by_detector) < MIN_AGENTS or BASE not in by_detector:
        found = ", ".join(by_detector) or "none"
        raise InputError(
            f"table ap-ds: expected runs of {MIN_AGENTS} detectors or more, {BASE} among them, found {found}"
        )
    precisions = list_compared(summary)
    tables = (
        build_detector_table(by_detector, precisions),
        build_precision_correlations(correlate_precisions(by_detector, precisions)),
    )
    return [part for table in tables for part in (format_markdown(table), table.note)]

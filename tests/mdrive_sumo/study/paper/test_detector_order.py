"""Precision beside driving: surrogates stay apart, and the order in open loop counts, too."""

import pytest
from testing.study_samples import make_open_run, make_recording, make_run, make_scenario

from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.detector_order import (
    OPEN_PRECISION,
    SURROGATES,
    build_detector_table,
    build_precision_correlations,
    correlate_open_precision,
    correlate_precisions,
    select_detectors,
)

PRECISIONS = {"AP@0.5 clean": {"none": 50.0, "late": 60.0, "cobevt": 70.0}}
DETECTORS = ("cobevt:profile", "none", "late", "cobevt")


def drive(detector: str, ds: float, scenarios: int = 12) -> Results:
    agent = f"perception-swap:{detector}"
    return make_run(*(make_scenario(f"s{place}", ds + place) for place in range(scenarios)), agent=agent)


def drive_all() -> dict[str, Results]:
    """By agent: the less precise, the better they drive; an agent with a planner of its own besides."""
    runs = {f"perception-swap:{name}": drive(name, 70.0 - 10 * place) for place, name in enumerate(DETECTORS)}
    return {"idm": make_run(make_scenario("s0", 1.0), agent="idm"), **runs}


@pytest.mark.slow
def test_surrogates_stand_apart_and_in_no_correlation() -> None:
    detectors = select_detectors(drive_all())
    assert [*detectors] == ["none", "late", "cobevt", "cobevt:profile"]
    table = build_detector_table(detectors, PRECISIONS)
    assert [row.section for row in table.rows] == ["", "", "", SURROGATES]
    assert [cell.value for cell in table.find_column("AP@0.5 clean")] == [50.0, 60.0, 70.0, None]
    assert [cell.value for cell in table.find_column("gain")] == [None, -10.0, -20.0, None]
    assert [row.is_ranked for row in table.rows] == [True, True, True, False]
    correlations = correlate_precisions(detectors, PRECISIONS)
    assert {one.agents for one in correlations} == {("none", "late", "cobevt")}
    shown = build_precision_correlations(correlations).rows[0].cells
    assert [cell.value for cell in shown] == ["AP@0.5 clean", "DS", pytest.approx(-1.0), pytest.approx(-1.0)]
    assert correlate_precisions(select_detectors({"perception-swap:none": drive("none", 1.0)}), PRECISIONS) == ()


@pytest.mark.slow
def test_precision_in_open_loop_is_compared_among_trained_detectors_alone() -> None:
    """One true detection of four less for each detector: the order is that of driving."""
    runs = drive_all()
    opened = {
        name: make_open_run(name, [make_recording(f"s{i}", 1.0, ((0.5, 15 - 4 * place, 15),)) for i in range(12)])
        for place, name in enumerate(runs)
        if name != "idm"
    }
    found = {one.score: one for one in correlate_open_precision(opened, runs)}
    assert {one.metric for one in found.values()} == {OPEN_PRECISION}
    assert found["ds"].agents == ("perception-swap:none", "perception-swap:late", "perception-swap:cobevt")
    assert found["ds"].spearman is not None and found["ds"].spearman.mean == pytest.approx(1.0)
    assert correlate_open_precision({"idm": opened["perception-swap:none"]}, runs) == ()

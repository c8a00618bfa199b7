"""Open loop against closed loop: numbers by hand, and resampled metrics against those of the open loop itself."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.study_samples import make_open_run, make_recording, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ResampledMean
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.detector_figures import MIN_IOUS, DetectorFigures, FigureKey
from mdrive_sumo.learning.fusion.detector_tables import write_detectors_json
from mdrive_sumo.open_loop import OpenLoopResults, OpenLoopScenario
from mdrive_sumo.open_loop.results import combine_metrics
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.detector_precision import load_precisions
from mdrive_sumo.study.paper.open_closed import OPEN_METRICS, compare_open_with_closed, resample_metric
from mdrive_sumo.study.paper.open_closed_table import (
    MEASURED_LABELS,
    build_correlation_table,
    build_detector_correlation_table,
    build_detector_table,
    build_open_closed_table,
    make_open_closed_figure,
)

COUNTS = st.tuples(st.integers(0, 10), st.integers(0, 10))
RECORDINGS = st.lists(
    st.builds(
        lambda ade, frames, rows: make_recording(
            "s",
            ade,
            tuple((score / 10, min(row), max(row)) for score, row in sorted(rows.items(), reverse=True)),
            frames,
        ),
        st.none() | st.floats(0, 5),
        st.integers(1, 40),
        st.dictionaries(st.integers(0, 10), COUNTS.filter(max), max_size=4),
    ),
    min_size=1,
    max_size=5,
)


@pytest.mark.slow
@given(RECORDINGS, st.data())
def test_resampled_metrics_are_those_of_the_resampled_recordings(
    recordings: list[OpenLoopScenario], data: st.DataObject
) -> None:
    counts = np.array([data.draw(st.lists(st.integers(0, 3), min_size=len(recordings), max_size=len(recordings)))])
    drawn = [one for one, count in zip(recordings, counts[0], strict=True) for _ in range(count)]
    whole = combine_metrics(drawn) if drawn else None
    for metric in OPEN_METRICS:
        expected = None if whole is None else getattr(whole, metric)
        found = float(resample_metric(recordings, metric, counts.astype(float))[0])
        no_scores = metric == "ap50" and not any(one.precision_counts for one in recordings)
        if expected is None or no_scores:
            assert np.isnan(found) or no_scores
        else:
            assert found == pytest.approx(expected, abs=1e-5)  # published numbers have 6 decimals


def both(
    scores: Mapping[str, tuple[float, float]], scenarios: int = 6
) -> tuple[dict[str, OpenLoopResults], dict[str, Results]]:
    """Agents by name with ADE and DS; ADE varies over scenarios in the same way for all."""
    names = [f"s{place}" for place in range(scenarios)]
    shown = {
        agent: make_open_run(
            agent, [make_recording(name, ade + place / 10, ((1.0, 10, 20),)) for place, name in enumerate(names)]
        )
        for agent, (ade, _) in scores.items()
    }
    driven = {agent: make_run(*(make_scenario(name, ds) for name in names)) for agent, (_, ds) in scores.items()}
    return shown, driven


@pytest.mark.slow
@pytest.mark.usefixtures("intervals_of_few")
def test_perfect_agreement_and_perfect_disagreement() -> None:
    agree = compare_open_with_closed(*both({"a": (0.5, 90.0), "b": (1.0, 80.0), "c": (2.0, 10.0)}))
    found = {(one.metric, one.score): one for one in agree.correlations}["ade", "ds"]
    assert found.spearman is not None and found.kendall is not None
    assert (found.spearman.mean, found.kendall.mean) == pytest.approx((1.0, 1.0))
    assert found.spearman.ends == pytest.approx((1.0, 1.0))
    assert agree.scenarios == 6 and [line.ds for line in agree.lines] == [90.0, 80.0, 10.0]
    against = compare_open_with_closed(*both({"a": (2.0, 90.0), "b": (1.0, 80.0), "c": (0.5, 10.0)}))
    found = {(one.metric, one.score): one for one in against.correlations}["ade", "ds"]
    assert found.kendall is not None and found.kendall.mean == pytest.approx(-1.0)
    ties = {(one.metric, one.score): one for one in agree.correlations}["ap50", "ds"]
    assert ties.spearman is None and ties.agents == ("a", "b", "c"), "all have the same AP"


def test_the_reference_counts_in_no_correlation_and_two_agents_have_none() -> None:
    shown, driven = both({"a": (0.5, 90.0), "b": (1.0, 80.0), "omniscient": (0.1, 1.0)})
    found = compare_open_with_closed(shown, driven)
    assert all(one.spearman is None and "omniscient" not in one.agents for one in found.correlations)
    table = build_open_closed_table(found)
    assert [row.is_ranked for row in table.rows] == [True, True, False]
    assert {cell.value for cell in build_correlation_table(found).find_column("spearman")} == {None}


def swap(*detectors: str) -> list[str]:
    return [f"perception-swap:{detector}" for detector in detectors]


@pytest.mark.slow
@pytest.mark.usefixtures("intervals_of_few")
def test_the_order_of_precision_stands_beside_the_order_of_driving(tmp_path: Path) -> None:
    """The file is one of `learn evaluate-detectors`; detectors drive in the reverse order of their precision."""
    none, late, cobevt, surrogate = agents = swap("none", "late", "cobevt", "cobevt:profile")
    write_precisions(tmp_path / "detectors.json", {"none": 0.5, "late": 0.6, "cobevt": 0.7})
    precisions = load_precisions(tmp_path / "detectors.json")
    shown, driven = both({agent: (1.0, 90.0 - 10 * place) for place, agent in enumerate(agents)})
    measured = {metric: {agent: one.mean for agent, one in each.items()} for metric, each in precisions.items()}
    comparison = compare_open_with_closed(shown, driven, measured)
    table = build_detector_table(comparison, precisions)
    assert [cell.value for cell in table.find_column("agent")] == [cobevt, late, none, surrogate], "most precise first"
    assert [cell.value for cell in table.find_column("ap50_clean")] == [*map(pytest.approx, (70.0, 60.0, 50.0)), None]
    assert table.rows[0].cells[1].interval is not None and table.rows[0].cells[1].interval.ends is not None
    assert [cell.value for cell in table.find_column("place_ap50_clean")] == [1.0, 2.0, 3.0, None]
    assert [cell.value for cell in table.find_column("place_ds")] == [3.0, 2.0, 1.0, None]
    assert "surrogates" in table.rows[3].section and not table.rows[3].is_ranked
    rows = [[cell.value for cell in row.cells] for row in build_detector_correlation_table(comparison).rows]
    assert ["AP50 clean [%]", "DS", 3.0] in [row[:3] for row in rows], "the surrogate is in none of them"
    assert [row[3] for row in rows if row[:2] == ["AP70 clean [%]", "SR"]] == pytest.approx([-1.0])
    assert {row[0] for row in rows} == {*(label[:-2] for label in MEASURED_LABELS.values()), "AP50 in open loop [%]"}
    (clean,) = (one for one in comparison.correlations if (one.metric, one.score) == ("ap50_clean", "ds"))
    assert clean.kendall is not None and clean.kendall.ends == pytest.approx((-1.0, -1.0))
    without = build_detector_table(compare_open_with_closed(shown, driven), {})
    assert "none are given (--detectors FILE)" in without.note
    assert {cell.value for cell in without.find_column("ap50_clean")} == {None}


def write_precisions(path: Path, value_by_detector: Mapping[str, float]) -> None:
    """As `learn evaluate-detectors` writes them, with 20 places."""
    figures = {name: DetectorFigures(name, {}) for name in value_by_detector}
    for name, value in value_by_detector.items():
        for condition in CONDITIONS:
            for min_iou in MIN_IOUS:
                mean = ResampledMean(value, np.linspace(value - 0.1, value + 0.1, 10_000), 20, 20.0)
                figures[name].precisions[FigureKey(condition.name, min_iou, "all")] = mean
    path.write_text(write_detectors_json(figures))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "cannot be read"),
        ("{", "JSON"),
        ('{"format": "mdrive-sumo/gain/1", "precisions": []}', "format: .*mdrive-sumo/detectors/1"),
        ('{"format": "mdrive-sumo/detectors/1", "precisions": []}', "expected those of detectors in clean frames"),
        (
            '{"format": "mdrive-sumo/detectors/1", "precisions": [{"detector": "none", "condition": "clean",'
            ' "iou": 0.5, "group": "all", "mean": 60.0, "low": null, "high": null, "units": 9}]}',
            r"precisions\.0\.mean: .*less than or equal to 1",
        ),
    ],
)
def test_another_file_than_one_of_detectors_is_refused(text: str | None, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "detectors.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=f"detectors.json: .*{problem}"):
        load_precisions(path)


@pytest.mark.slow
def test_void_episodes_and_agents_without_plans_are_left_out() -> None:
    shown, driven = both({"a": (0.5, 90.0), "b": (1.0, 80.0), "c": (2.0, 10.0)})
    void = driven["b"].scenarios[0].model_copy(update={"status": "void", "ds": 0.0})
    driven["b"] = make_run(void, *driven["b"].scenarios[1:])
    shown["d"] = make_open_run("d", [make_recording(f"s{place}", None) for place in range(6)])
    driven["d"] = make_run(*(make_scenario(f"s{place}", 5.0) for place in range(6)))
    found = compare_open_with_closed(shown, driven)
    assert found.scenarios == 5
    assert {line.agent: line.open.ade for line in found.lines}["d"] is None
    assert {one.agents for one in found.correlations if one.metric == "ade"} == {("a", "b", "c")}
    nothing = compare_open_with_closed({"a": make_open_run("a", [make_recording("x", 1.0)])}, {"a": driven["a"]})
    assert (nothing.scenarios, nothing.lines, nothing.correlations) == (0, (), ())


@pytest.mark.slow
def test_the_figure_has_the_papers_axes_and_every_agent() -> None:
    shown, driven = both({"a": (0.5, 90.0), "b": (1.0, 80.0), "omniscient": (0.1, 99.0)}, scenarios=2)
    (svg,) = make_open_closed_figure(compare_open_with_closed(shown, driven)).render("svg")
    for text in (b"AP50", b"ADE", b"DS", b"SR", b"omniscient"):
        assert b"<!-- " + text in svg, "matplotlib draws text as paths and names it in a comment"

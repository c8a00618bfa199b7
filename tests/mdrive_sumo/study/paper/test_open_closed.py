"""Open loop against closed loop: numbers by hand, and resampled metrics against those of the open loop itself."""

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.study_samples import make_open_run, make_recording, make_run, make_scenario

from mdrive_sumo.open_loop import OpenLoopResults, OpenLoopScenario
from mdrive_sumo.open_loop.results import combine_metrics
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.open_closed import OPEN_METRICS, compare_open_with_closed, resample_metric
from mdrive_sumo.study.paper.open_closed_table import (
    build_correlation_table,
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

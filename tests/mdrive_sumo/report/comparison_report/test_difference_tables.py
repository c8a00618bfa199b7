"""Paired differences of agents: against other methods, pairing by scenario and seed, void scenarios, baseline."""

from dataclasses import astuple
from itertools import product

import numpy as np
import pytest
from testing.report_samples import BEST, CRASH, SHARING, SINGLE, make_agent_run, make_sample_runs

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_cell
from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.difference_tables import (
    AgentDifference,
    build_bucket_difference_table,
    build_difference_table,
    compute_differences,
)
from mdrive_sumo.runs.compare import compare
from mdrive_sumo.scoring import Results, summarize_run

CASES = {"i01": 10.0, "i02": 55.0, "cone": 80.0, "walker": 15.0, "left": 90.0, "log": 50.0}


def subtract(first: Results, second: Results) -> AgentDifference:
    """Return first minus second."""
    agents = make_agents_of_results([first, second])
    (found,) = compute_differences(agents, next(one.name for one in agents if one.results.run == second.run))
    return found


def test_one_seed_is_what_compare_finds() -> None:
    sharing = make_agent_run("sharing", SHARING, exchanged=("cam", "cpm"))
    found = subtract(sharing, make_agent_run("single", SINGLE))
    expected = compare(make_agent_run("single", SINGLE), sharing)
    for ours, theirs in ((found.ds, expected.ds), (found.sr, expected.sr)):
        assert ours is not None and astuple(ours) == pytest.approx(astuple(theirs), abs=1e-9)
    assert found.scenarios == len(expected.pairs) and (found.wins, found.losses) == (2, 0)
    assert found.time_ratio is not None and found.time_ratio.mean == 0


@pytest.mark.slow  # scipy.stats is imported
@pytest.mark.usefixtures("intervals_of_few")
def test_the_interval_is_near_scipys() -> None:
    """scipy.stats.bootstrap draws with a generator of its own."""
    from scipy import stats

    ours = make_agent_run("a", {name: (value,) for name, value in CASES.items()})
    found = subtract(ours, make_agent_run("b", dict.fromkeys(CASES, (45.0,))))
    differences = (np.array([*CASES.values()]) - 45.0,)
    other = stats.bootstrap(differences, np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(5))
    assert found.ds is not None and found.ds.mean == pytest.approx(5.0)
    bounds = (other.confidence_interval.low, other.confidence_interval.high)
    assert found.ds.ends == pytest.approx(bounds, abs=1.5)


@pytest.mark.usefixtures("intervals_of_few")
def test_scenarios_and_seeds_are_drawn_as_an_enumeration_has_it() -> None:
    """Two scenarios and two seeds have 2**2 * 4**2 equally likely draws: all of them give the exact percentiles."""
    values = {("i01", 0): 0.0, ("i01", 1): 8.0, ("i02", 0): 24.0, ("i02", 1): 40.0}
    runs = [make_agent_run("a", {name: (values[name, seed],) for name in ("i01", "i02")}, (seed,)) for seed in (0, 1)]
    agents = make_agents_of_results([*runs, make_agent_run("b", {"i01": (0.0,), "i02": (0.0,)}, (0, 1))])
    (found,) = compute_differences(agents, "b")
    means = [
        np.mean([values[name, seed] for name, pair in zip(names, draw, strict=True) for seed in pair])
        for names in product(("i01", "i02"), repeat=2)
        for draw in product(list(product((0, 1), repeat=2)), repeat=2)
    ]
    assert len(means) == 4 * 16
    exact = np.quantile(means, (0.025, 0.975), method="inverted_cdf")
    assert found.ds is not None and found.seeds == (0, 1) and found.ds.mean == pytest.approx(18.0)
    assert found.ds.ends == pytest.approx(tuple(exact), abs=1e-9)


@pytest.mark.usefixtures("intervals_of_few")
def test_buckets_are_drawn_on_their_own() -> None:
    """One scenario in each bucket leaves nothing to chance within the buckets."""
    ours = make_agent_run("a", {"i01": (90.0,), "cone": (50.0,), "log": (10.0,)})
    found = subtract(ours, make_agent_run("b", {"i01": (0.0,), "cone": (0.0,), "log": (0.0,)}))
    mean = found.bucket_mean[0]
    assert mean is not None and (mean.mean, mean.ends) == (50.0, (50.0, 50.0))
    assert found.ds is not None and found.ds.ends is not None and found.ds.ends[0] < 50 < found.ds.ends[1]
    assert [pair[0].mean for pair in found.buckets.values() if pair[0]] == [90.0, 50.0, 10.0]


def test_few_scenarios_in_one_bucket_leave_the_mean_of_the_buckets_without_an_interval() -> None:
    crossing, log = (make_agent_run("a", {name: (90.0,)}).scenarios[0] for name in ("i01", "log"))
    ours = [crossing.model_copy(update={"id": f"i{place}"}) for place in range(12)] + [log]
    theirs = [one.model_copy(update={"ds": 50.0}) for one in ours]
    info = make_agent_run("a", SINGLE).run
    found = subtract(
        *(summarize_run(info.model_copy(update={"agent": name}), of) for name, of in (("a", ours), ("b", theirs)))
    )
    assert found.ds is not None and found.ds.ends == (40.0, 40.0)
    assert found.bucket_mean[0] is not None and (found.bucket_mean[0].ends, found.bucket_mean[0].units) == (None, 1)
    assert not found.bucket_mean[0].is_clear
    table = build_difference_table([subtract(make_agent_run("a", SHARING), make_agent_run("b", SINGLE))])
    assert "[too few]" in format_cell(table.find_column("ds")[0], table.columns[4])


def test_seeds_that_both_have_are_paired_and_others_averaged() -> None:
    shared = subtract(make_agent_run("a", SHARING, (0, 1, 2)), make_agent_run("b", SINGLE, (2, 1)))
    assert shared.seeds == (1, 2)
    apart = subtract(make_agent_run("a", SHARING, (0, 1)), make_agent_run("b", SINGLE, (5,)))
    assert apart.seeds == () and apart.ds == subtract(make_agent_run("a", SHARING), make_agent_run("b", SINGLE)).ds
    assert [cell.value for cell in build_difference_table([shared, apart]).find_column("seeds")] == ["1, 2", "means"]


def test_void_scenarios_are_left_out() -> None:
    found = subtract(make_agent_run("a", {**BEST, "i01": ()}), make_agent_run("b", {**SINGLE, "log": ()}))
    assert found.scenarios == 4
    nothing = subtract(make_agent_run("a", {"i01": ()}), make_agent_run("b", {"i01": (CRASH,)}))
    assert nothing.scenarios == 0 and nothing.ds is None and nothing.bucket_mean == (None, None)
    assert build_difference_table([nothing]).find_column("ds")[0].value is None


@pytest.mark.slow
def test_every_pair_once_upper_bounds_first_or_a_baseline() -> None:
    agents = make_agents_of_results(make_sample_runs().values())
    pairs = [(one.agent, one.other) for one in compute_differences(agents)]
    assert len(pairs) == 6 and pairs[0] == ("omniscient", "sharing (channel ideal)")
    assert {frozenset(pair) for pair in pairs} == {
        frozenset((a.name, b.name)) for a, b in product(agents, agents) if a is not b
    }
    to_single = compute_differences(agents, "single")
    assert [one.other for one in to_single] == ["single"] * 3
    turned = next(one for one in compute_differences(agents) if (one.agent, one.other)[1] == "single")
    same = next(one for one in to_single if one.agent == turned.agent)
    assert same == turned
    with pytest.raises(InputError, match=r"--baseline: expected one of single, .*did you mean 'omniscient'"):
        compute_differences(agents, "omnicient")


def test_tables_of_differences() -> None:
    differences = compute_differences(make_agents_of_results(make_sample_runs().values()))
    by_bucket = build_bucket_difference_table(differences)
    assert by_bucket is not None and [name for name, _ in by_bucket.groups] == [
        *("", "", "InterDrive", "Interaction", "V2XPnP", "Overall")
    ]
    one = make_agents_of_results([make_agent_run("a", {"i01": (1.0,)}), make_agent_run("b", {"i01": (2.0,)})])
    assert build_bucket_difference_table(compute_differences(one)) is None
    assert build_bucket_difference_table([]) is None

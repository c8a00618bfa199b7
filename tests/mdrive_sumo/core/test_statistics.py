"""Intervals by the nested bootstrap: against other methods, properties, too few clusters, many comparisons."""

import time
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mdrive_sumo.core import statistics
from mdrive_sumo.core.statistics import (
    MIN_UNITS,
    RESAMPLES,
    ConfidenceInterval,
    Label,
    Verdict,
    adjust_holm,
    bootstrap_nested,
    compute_expanded_p_value,
    compute_expanded_tail,
    compute_kendall,
    compute_spearman,
    count_effective,
    describe_comparisons,
    describe_too_few,
    draw_nested_counts,
    format_interval_cells,
    judge_interval,
    judge_intervals,
    make_interval,
    resample_nested,
    sum_resamples,
)


def measure_width(interval: ConfidenceInterval) -> float:
    """Return how wide an interval is."""
    assert interval.ends is not None
    return interval.ends[1] - interval.ends[0]


def label(*sizes: int) -> list[Label]:
    """Return the labels of a tree whose nodes on each level have so many children."""
    return [tuple(map(int, index)) for index in np.ndindex(*sizes)]


def test_the_interval_of_two_equally_likely_values_is_the_binomial_one() -> None:
    """The mean of 100 draws of 0 or 1 has standard deviation 0.05: 95 % lie within 1.984 of it, Student's quantile."""
    found = bootstrap_nested([0.0, 1.0] * 50, label(100))
    assert found.mean == 0.5
    assert found.ends == pytest.approx((0.5 - 1.984 * 0.05, 0.5 + 1.984 * 0.05), abs=0.011)


def test_the_error_of_clusters_is_that_of_their_means() -> None:
    """Values of one place are alike, so the standard error is that of the 40 means, not of 200 values."""
    random = np.random.default_rng(3)
    places = random.normal(10, 5, 40)
    found = bootstrap_nested(np.repeat(places, 5), label(40, 5))
    assert measure_width(found) == pytest.approx(2 * 2.023 * places.std(ddof=1) / 40**0.5, rel=0.06)
    assert measure_width(bootstrap_nested(np.repeat(places, 5), label(200))) < 0.6 * measure_width(found)


@pytest.mark.slow  # scipy.stats is imported
@pytest.mark.parametrize("size", [20, 60])
def test_it_agrees_with_the_bootstrap_and_the_t_interval_of_scipy(size: int) -> None:
    from scipy import stats

    values = np.random.default_rng(size).normal(3, 10, size)
    found = bootstrap_nested(values, label(size))
    low, high = stats.t.interval(0.95, size - 1, values.mean(), stats.sem(values))
    assert found.ends == pytest.approx((low, high), abs=0.08 * (high - low))
    p_value = 2 * stats.t.sf(abs(values.mean()) / stats.sem(values), size - 1)
    assert found.p_value == pytest.approx(p_value, abs=0.03)
    there = stats.bootstrap((values,), np.mean, method="percentile", rng=np.random.default_rng(1)).confidence_interval
    assert measure_width(found) == pytest.approx((there.high - there.low) * (1 + 2 / size), rel=0.08)
    for freedom in (3, 4, 9, 24, 100):
        expected = stats.norm.cdf(-(((freedom + 1) / freedom) ** 0.5) * stats.t.ppf(0.975, freedom))
        assert compute_expanded_tail(freedom + 1) == pytest.approx(expected, rel=0.2 if freedom == 3 else 0.06)


@given(st.floats(4, 500))
def test_p_values_and_intervals_say_the_same(clusters: float) -> None:
    assert compute_expanded_p_value(compute_expanded_tail(clusters), clusters) == pytest.approx(0.05, abs=5e-4)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20), st.randoms())
def test_the_interval_is_deterministic_within_the_values_and_in_no_order(values: list[float], random: object) -> None:
    found = bootstrap_nested(values, label(len(values)))
    order = np.random.default_rng(len(values)).permutation(len(values))
    labels = label(len(values))
    assert found == bootstrap_nested(np.array(values)[order], [labels[i] for i in order])
    assert found == bootstrap_nested(values, [(place[0], "scenario", 0) for place in labels]), "equal clusters of one"
    assert found.units == len(values)
    assert (found.ends is None) == (len(values) < MIN_UNITS)
    if found.ends is not None:
        slack = 1e-9
        assert min(values) - slack <= found.ends[0] <= found.ends[1] <= max(values) + slack


def test_order_does_not_matter_with_strata_and_clusters_of_unlike_sizes() -> None:
    random = np.random.default_rng(2)
    labels: list[Label] = [(f"place{i % 11}", f"scenario{i}", seed) for i in range(40) for seed in (0, 1)]
    strata = [("east", "west")[i % 2] for i in range(40) for _ in (0, 1)]
    values = random.normal(5, 3, 80)
    found = bootstrap_nested(values, labels, strata)
    order = random.permutation(80)
    moved = bootstrap_nested(values[order], [labels[i] for i in order], [strata[i] for i in order])
    assert found == moved and found.ends is not None
    assert found.mean == pytest.approx(
        (values[:80].reshape(-1, 4)[:, :2].mean() + values.reshape(-1, 4)[:, 2:].mean()) / 2
    )


def test_strata_weigh_alike_and_are_drawn_on_their_own_and_weights_subtract() -> None:
    values, strata = [10.0] * 24 + [40.0] * 20, ["a"] * 24 + ["b"] * 20
    labels = [(name, *rest) for name, rest in zip(range(44), label(44), strict=True)]
    found = bootstrap_nested(values, labels, strata)
    assert (found.mean, found.ends, found.units) == (25.0, (25.0, 25.0), 20)
    assert bootstrap_nested(values, labels, strata, {"a": -1.0, "b": 1.0}).ends == (30.0, 30.0)
    noisy = np.random.default_rng(0).normal(0, 1, 100)
    both = bootstrap_nested([*noisy, *noisy], label(200), ["a"] * 100 + ["b"] * 100)
    assert measure_width(both) == pytest.approx(measure_width(bootstrap_nested(noisy, label(100))) / 2**0.5, rel=0.08)


def test_seeds_that_agree_add_no_certainty_about_other_scenarios() -> None:
    """Four equal seeds of each of 25 scenarios are 25 values and not 100: the interval is that of one seed."""
    values = np.array([0.0, 1.0] * 50)[:25]
    one, four = bootstrap_nested(values, label(25)), bootstrap_nested(np.repeat(values, 4), label(25, 4))
    assert four.mean == one.mean
    assert four.ends == pytest.approx(one.ends, abs=0.02)


def test_seeds_that_differ_widen_the_interval_of_equal_scenarios() -> None:
    """The standard deviation of a seed is 0.5, so that of a mean of 10 x 2 about 0.5 / √20; t of 9 degrees is 2.26."""
    found = bootstrap_nested([0.0, 1.0] * 10, label(10, 2))
    assert measure_width(found) == pytest.approx(2 * 2.26 * 0.5 / 20**0.5 * (10 / 9) ** 0.5, abs=0.1)


def test_differences_of_means_are_those_of_paired_values() -> None:
    random = np.random.default_rng(1)
    first, second, labels = random.normal(5, 2, 36), random.normal(4, 2, 36), label(12, 3)
    found = resample_nested(first, labels).subtract(resample_nested(second, labels))
    direct = bootstrap_nested(first - second, labels)
    assert found.mean == pytest.approx(direct.mean) and found.ends == pytest.approx(direct.ends)


@pytest.mark.parametrize("units", [1, MIN_UNITS - 1])
def test_too_few_clusters_give_neither_an_interval_nor_a_verdict(units: int) -> None:
    """Also with many scenarios on each, where all values are alike, and where one stratum is small."""
    few = [26.7] * (units * 6)
    mixed = [("few", *one) for one in label(units, 6)], [("many", *one) for one in label(50, 6)]
    for found in (
        bootstrap_nested(few, label(units, 6)),
        bootstrap_nested([26.7] * (units * 6 + 300), [one[1:] for part in mixed for one in part],
                         [str(one[0]) for part in mixed for one in part]),
    ):  # fmt: skip
        assert (found.mean, found.ends, found.units) == (pytest.approx(26.7), None, units)
        assert (judge_interval(found), found.is_clear) == (Verdict.TOO_FEW, False)
        assert format_interval_cells(found, "+.1f") == ("+26.7", "-", "-")
        assert describe_too_few(found).startswith(f"{units} place") and "needs 10" in describe_too_few(found)
    many = bootstrap_nested([26.7] * 100, label(50, 2))
    assert judge_interval(many) is Verdict.GAIN and not describe_too_few(many)


def test_clusters_of_which_one_has_most_values_are_too_few() -> None:
    labels: list[Label] = [*(("crossing", i) for i in range(70)), *((f"place{i}", 0) for i in range(11))]
    assert count_effective(labels) == pytest.approx(81 * 81 / (70 * 70 + 11))
    found = bootstrap_nested(np.arange(81.0), labels)
    assert found.ends is None and describe_too_few(found) == (
        "12 places, but most scenarios lie on fewer than 4 of them: too few for an interval"
    )


@pytest.mark.slow  # 400 intervals
@pytest.mark.parametrize(("places", "least"), [(10, 0.90), (12, 0.91), (25, 0.93)])
def test_intervals_hold_the_true_mean_of_places_that_differ(places: int, least: float) -> None:
    """Places of unlike sizes with a spread of their own as large as that of scenarios (decision 094)."""
    random = np.random.default_rng(places)
    sizes = random.integers(1, 8, size=places)
    labels: list[Label] = [(place, i) for place, size in enumerate(sizes) for i in range(size)]
    held = 0
    for _ in range(200):
        values = random.normal(0, 1, places)[[int(one[0]) for one in labels]] + random.normal(0, 1, len(labels))
        low, high = bootstrap_nested(values, labels).ends or (0.0, 0.0)
        held += low <= 0.0 <= high
    assert held >= least * 200


@pytest.mark.slow
def test_resamples_of_a_whole_study_take_well_below_a_second() -> None:
    values, labels = np.random.default_rng(0).normal(0, 1, 1125), label(75, 3, 5)
    statistics._draw_counts.cache_clear()
    start = time.process_time()
    bootstrap_nested(values, labels)
    assert time.process_time() - start < 2.0, "measured: 0.4 s"


def test_a_label_that_occurs_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="all different"):
        bootstrap_nested([1.0, 2.0], [("a", 0), ("a", 0)])


def test_holm_by_hand() -> None:
    """Example of Holm (1979): 0.01, 0.02, 0.03 and 0.04 times 4, 3, 2, 1, never falling."""
    assert adjust_holm((0.04, 0.01, 0.03, 0.02)) == pytest.approx((0.06, 0.04, 0.06, 0.06))
    assert adjust_holm(()) == () and adjust_holm((0.5, 0.9)) == (1.0, 1.0)


def test_many_differences_are_corrected_and_counted() -> None:
    strong, weak = ConfidenceInterval(2.0, 1.0, 3.0, 50, 0.001), ConfidenceInterval(1.0, 0.1, 2.0, 50, 0.04)
    none, few = ConfidenceInterval(0.1, -1.0, 1.0, 50, 0.8), ConfidenceInterval(9.0, None, None, 3)
    assert judge_intervals([strong, weak, none, few]) == (Verdict.GAIN, Verdict.CHANCE, Verdict.NONE, Verdict.TOO_FEW)
    assert judge_intervals([weak]) == (Verdict.GAIN,), "one comparison is not corrected"
    text = describe_comparisons([strong, weak, none, few, None])
    assert (
        text.startswith("Of 3 differences with an interval 2 exclude 0, where chance alone gives 0.2")
        and "; 1 " in text
    )
    assert describe_comparisons([strong, few]) == ""


def test_of_differences_that_are_none_hardly_any_remains() -> None:
    random, labels = np.random.default_rng(5), label(30)
    found = [bootstrap_nested(random.normal(0, 1, 30), labels) for _ in range(100)]
    assert 1 <= sum(one.is_clear for one in found) <= 11
    assert {*judge_intervals(found)} <= {Verdict.NONE, Verdict.CHANCE}


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(-2, -1, "loss"), (-1, 0, "no difference shown"), (0, 0, "no difference shown"), (0, 2, "no difference shown"),
     (0.1, 2, "gain")],
)  # fmt: skip
def test_only_intervals_without_0_show_a_difference(low: float, high: float, verdict: str) -> None:
    assert judge_interval(ConfidenceInterval(0.5 * (low + high), low, high, MIN_UNITS)) == verdict


SAMPLES = st.integers(3, 9).flatmap(
    lambda size: st.tuples(*[arrays.arrays(np.float64, size, elements=st.integers(0, 4))] * 2)
)
"""Two rows of few different values, so that ties are frequent."""


@pytest.mark.slow  # scipy.stats is imported
@given(SAMPLES)
def test_they_are_those_of_scipy(pair: tuple[np.ndarray, np.ndarray]) -> None:
    from scipy import stats

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all values tied: NaN there and here
        expected = stats.spearmanr(*pair)[0], stats.kendalltau(*pair)[0]
    found = float(compute_spearman(*pair)), float(compute_kendall(*pair))
    assert found == pytest.approx(expected, abs=1e-12, nan_ok=True)


def test_by_hand() -> None:
    order, other = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 3.0, 2.0, 4.0])
    assert float(compute_kendall(order, other)) == pytest.approx(4 / 6)  # 5 pairs agree, 1 does not
    assert float(compute_spearman(order, other)) == pytest.approx(1 - 6 * 2 / (4 * 15))
    assert float(compute_kendall(order, -order)) == float(compute_spearman(order, -order)) == -1.0


def test_many_rows_at_once_and_values_that_differ_in_the_last_bit() -> None:
    x = np.array([[0.1 + 0.2, 0.3, 0.5], [1.0, 2.0, 3.0]])
    y = np.array([[1.0, 1.0, 2.0], [3.0, 2.0, 1.0]])
    assert compute_spearman(x, y).tolist() == pytest.approx([1.0, -1.0])
    assert compute_kendall(x, y).tolist() == pytest.approx([1.0, -1.0])


def test_counts_give_the_interval_of_a_mean() -> None:
    values = np.array([0.0, 1.0, 5.0, 9.0, 10.0] * 2)
    counts = draw_nested_counts(label(10))
    assert counts.shape == (1 + RESAMPLES, 10)
    assert counts[0].tolist() == [1] * 10 and set(counts.sum(axis=1)) == {10}
    found, expected = (
        make_interval(5.0, sum_resamples(counts, values)[1:] / 10, 10, 10.0),
        bootstrap_nested(values, label(10)),
    )
    assert found.ends is not None and found.ends == pytest.approx(expected.ends)
    assert sum_resamples(counts, np.stack((values, -values), axis=-1)).sum() == 0

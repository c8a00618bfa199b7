"""Aggregation of CAVs, scenarios and buckets, with expectations worked out by hand."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import scenario
from testing.scored_pair import RUN

from mdrive_sumo.core.state import End
from mdrive_sumo.episode import Ending
from mdrive_sumo.scoring import (
    ScenarioResult,
    ScoreMode,
    compute_category_group_means,
    compute_category_means,
    compute_harmonic_mean,
    compute_interdrive_means,
    compute_level_means,
    compute_overall,
    compute_scenario_means,
    make_void_result,
    summarize_run,
)
from mdrive_sumo.scoring.metrics import EgoRecord, InfractionEvent, SpeedExcess

FACTORS = {
    "collision-pedestrian": 0.5,
    "collision-vehicle": 0.6,
    "collision-static": 0.65,
    "stop-sign": 0.8,
    "red-light": 0.7,
}


def record(*kinds: str, ego_id: str = "0", rc: float = 100.0) -> EgoRecord:
    """A CAV with these infractions."""
    found = tuple(InfractionEvent(kind, 0, 0.0, 0.0, FACTORS[kind]) for kind in kinds)
    return EgoRecord(ego_id, Ending(ego_id, 9, End.ARRIVED), rc, found, SpeedExcess(0.0, 0.0))


def numbers(records: Sequence[EgoRecord], mode: str) -> tuple[float, float, float, float]:
    found = compute_scenario_means(records, ScoreMode(mode))
    return found.ds, found.sr, found.rc, found.ip


STOPPED_AND_HIT = record("collision-vehicle", "stop-sign")
"""IP 0.6 * 0.8 = 0.48."""


def test_mdrive_means_over_the_egos() -> None:
    """DS (48 + 100) / 2, one of two succeeds, IP (0.48 + 1) / 2."""
    assert numbers([STOPPED_AND_HIT, record()], "mdrive") == (74.0, 50.0, 100.0, 0.74)


def test_mdrive_is_a_mean_of_products_not_a_product_of_means() -> None:
    """DS (50 * 0.6 + 100) / 2 = 65, although mean RC 75 times mean IP 0.8 is 60."""
    assert numbers([record("collision-vehicle", rc=50.0), record()], "mdrive") == (65.0, 50.0, 75.0, 0.8)


def test_interdrive_asis_drops_ego_0_and_divides_out_its_stop_sign() -> None:
    """RC 100, IP 1 * 1, divided by 0.8: 125, a success (protocol 8.2, checked there against the original)."""
    assert numbers([STOPPED_AND_HIT, record()], "interdrive_asis") == (125.0, 100.0, 100.0, 1.0)


def test_interdrive_asis_counts_the_other_egos_and_forgives_only_ego_0() -> None:
    """IP 0.48 of ego 1; nothing is divided out, for ego 0 met no sign."""
    assert numbers([record(), STOPPED_AND_HIT], "interdrive_asis") == (48.0, 0.0, 100.0, 0.48)


def test_interdrive_fixed_divides_out_stop_signs_and_red_lights_of_all_egos() -> None:
    """RC (100 + 50) / 2 = 75; IP 0.48 * 0.7 = 0.336; over 0.8 and 0.7 that is 0.6: DS 45."""
    found = numbers([STOPPED_AND_HIT, record("red-light", rc=50.0)], "interdrive_fixed")
    assert found == (45.0, 0.0, 75.0, 0.336)


def test_interdrive_success_is_of_the_scenario() -> None:
    assert numbers([record("stop-sign"), record()], "interdrive_fixed")[:2] == (100.0, 100.0)
    assert numbers([record(rc=99.0), record()], "interdrive_fixed")[:2] == (99.5, 0.0)


@pytest.mark.parametrize(("share", "successes"), [(0.0005, 0.0), (0.00049, 100.0)])
def test_success_is_over_99_95(share: float, successes: float) -> None:
    off = EgoRecord(
        "0",
        Ending("0", 9, End.ARRIVED),
        100.0,
        (InfractionEvent("outside-lanes", 9, 0.0, 0.0, 1 - share),),
        SpeedExcess(0.0, 0.0),
    )
    assert numbers([off], "mdrive")[1] == successes


def scored(scenario_id: str, bucket: str, ds: float, category: str = "c") -> ScenarioResult:
    about = scenario(id=scenario_id, bucket=bucket, category=category)
    return make_void_result(about, 1, "").model_copy(
        update={"status": "ok", "ds": ds, "sr": ds / 2, "rc": ds / 4, "ip": ds / 100}
    )


MIXED = [
    scored("a", "One", 90.0),
    scored("b", "One", 60.0),
    scored("c", "One", 30.0),
    scored("d", "Two", 100.0),
]


def test_both_overall_means() -> None:
    """Buckets: One (90 + 60 + 30) / 3 = 60, Two 100; of buckets 80, of scenarios 280 / 4 = 70."""
    found = compute_overall(MIXED)
    assert (found.bucket_mean.ds, found.bucket_mean.sr) == (80.0, 40.0)
    assert (found.bucket_mean.rc, found.bucket_mean.ip) == (20.0, 0.8)
    assert (found.scenario_mean.ds, found.scenario_mean.sr) == (70.0, 35.0)


def test_void_scenarios_count_as_zero_and_are_reported_apart() -> None:
    found = summarize_run(RUN, [*MIXED, make_void_result(scenario(id="e", bucket="Two"), 1, "SUMO stopped")])
    assert found.void == 1
    assert (found.buckets["Two"].scenarios, found.buckets["Two"].ds) == (2, 50.0)
    assert (found.overall.bucket_mean.ds, found.overall.scenario_mean.ds) == (55.0, 56.0)
    last = found.scenarios[-1]
    assert (last.status, last.reason, last.min_ttc, last.egos) == ("void", "SUMO stopped", None, ())


def test_a_run_without_scenarios_has_no_mean() -> None:
    with pytest.raises(ValueError, match="at least one scenario"):
        summarize_run(RUN, [])


def test_category_figure() -> None:
    """H of DS 80 and SR 40 is 2 * 3200 / 120; by category: DS (90 + 30) / 2."""
    assert compute_harmonic_mean(compute_overall(MIXED).bucket_mean) == pytest.approx(53.333333)
    assert compute_harmonic_mean(scored("z", "One", 0.0)) == 0.0
    by_category = compute_category_means([scored("a", "One", 90.0, "x"), scored("b", "Two", 30.0, "x"), MIXED[3]])
    assert (by_category["x"].ds, by_category["x"].scenarios, by_category["c"].ds) == (60.0, 2, 100.0)


def test_interdrive_sub_categories() -> None:
    """By name crosschange is a lane change; InterDrive's own aggregator takes it for a merge (protocol 8.5)."""
    found = [
        scored("a", "InterDrive", 90.0, "ins_crosschange"),
        scored("b", "InterDrive", 50.0, "hw_merge"),
        scored("c", "InterDrive", 30.0, "hw_c"),
        scored("d", "InterDrive", 20.0, "ins_chaos"),
    ]
    by_name = {name: group.ds for name, group in compute_interdrive_means(found, ScoreMode.MDRIVE).items()}
    asis = {name: group.ds for name, group in compute_interdrive_means(found, ScoreMode.INTERDRIVE_ASIS).items()}
    assert by_name == {"IC": 20.0, "LC": 60.0, "LM": 50.0}
    assert asis == {"IC": 20.0, "LC": 30.0, "LM": 70.0}


def test_interactivity_levels() -> None:
    """Of Interaction's categories (protocol 1.2); others are left out."""
    found = [
        scored("a", "Interaction", 90.0, "overtaking"),
        scored("b", "Interaction", 50.0, "blocked-lane"),
        scored("c", "Interaction", 30.0, "crosswalk"),
        scored("d", "Interaction", 20.0, "roundabout"),
        scored("e", "InterDrive", 10.0, "hw_c"),
    ]
    by_level = {name: group.ds for name, group in compute_level_means(found).items()}
    assert by_level == {"static-avoidance": 70.0, "dynamic-avoidance": 30.0, "dynamic-coordination": 20.0}
    assert {"LC", "static-avoidance"} <= set(compute_category_group_means(found, ScoreMode.MDRIVE))


kinds = st.lists(st.sampled_from(sorted(FACTORS)), max_size=4)


@given(egos=st.lists(st.tuples(kinds, st.floats(0, 100)), min_size=1, max_size=6), shuffle=st.randoms())
def test_the_order_of_the_egos_does_not_matter_to_mdrive(egos: list[tuple[list[str], float]], shuffle: object) -> None:
    records = [record(*kinds, ego_id=str(i), rc=rc) for i, (kinds, rc) in enumerate(egos)]
    before = numbers(records, "mdrive")
    shuffle.shuffle(records)  # pyright: ignore
    assert numbers(records, "mdrive") == before

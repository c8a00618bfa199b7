"""Aggregation with expectations worked out on paper, and the results file."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.score_golden import Row, arriving, ego, episode, hit, judged, scenario, straight, street

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Contact, End, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, load_episode, save_episode
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import (
    Results,
    RunInfo,
    ScenarioResult,
    ScoreMode,
    build_results_schema,
    compute_category_group_means,
    compute_category_means,
    compute_harmonic_mean,
    compute_interdrive_means,
    compute_level_means,
    compute_overall,
    compute_scenario_means,
    load_results,
    make_void_result,
    save_results,
    score_episode,
    summarize_run,
)
from mdrive_sumo.scoring.metrics import EgoRecord, InfractionEvent

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
    return EgoRecord(ego_id, Ending(ego_id, 9, End.ARRIVED), rc, found)


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


def test_interdrive_fixed_divides_out_everyones_stops_and_reds() -> None:
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


RUN = RunInfo(
    agent="idm",
    labels=("single",),
    suite="s",
    suite_checksum="sha256:0",
    seed=1,
    score_mode="mdrive",
    versions={"mdrive-sumo": "0.1.0"},
)


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


# --- one episode, from recording to results


SIGN = StopSignBox(id="stop", lane="east", line_pos_m=100.0, length_m=6.0)
ROADS = street(signs=[SIGN])
PAIR = scenario(ego("0"), ego("1", y=3.2))


def pair_episode() -> EpisodeRecord:
    """Ego 0 hits a car and runs over the sign: IP 0.48. Ego 1, one lane to the left, fails at x = 20."""
    drives = {"0": arriving(), "1": straight(41, y=3.2)}
    ends = {"0": End.ARRIVED, "1": End.AGENT_FAILED}
    return episode(PAIR, drives, ends, {20: [hit("0", "npc")]})


def test_an_episode_makes_a_scenario_result() -> None:
    """Ego 1 starts on the west lane and stays there, which is no infraction; DS (48 + 19) / 2."""
    recorded = pair_episode()
    found = score_episode(recorded, PAIR, ROADS, ScoreMode.MDRIVE, seed=7)
    assert (found.id, found.seed, found.status, found.ticks) == ("s", 7, "ok", 203)
    assert (found.ds, found.sr, found.rc, found.ip) == (33.5, 0.0, 59.5, 0.74)
    assert found.digest == recorded.digest
    first, second = found.egos
    assert (first.ds, first.rc, first.ip, first.outcome, first.reason) == (48.0, 100.0, 0.48, "arrived", "")
    assert [(i.kind, i.tick, i.factor) for i in first.infractions] == [
        ("collision-vehicle", 20, 0.6),
        ("stop-sign", 101, 0.8),
    ]
    assert (second.ds, second.outcome, second.reason) == (19.0, "agent-failed", "crashed: ValueError: no")


def test_the_same_episode_in_every_mode() -> None:
    """Mean RC 59.5: asis * 1 / 0.8, fixed * 0.48 / 0.8."""
    found = {mode: score_episode(pair_episode(), PAIR, ROADS, mode, 1).ds for mode in ScoreMode}
    assert found == {"mdrive": 33.5, "interdrive_fixed": 35.7, "interdrive_asis": 74.375}


steps = st.tuples(st.floats(-0.1, 0.9), st.floats(-0.3, 0.3), st.floats(-3, 3), st.integers(1, 60))
contacts = st.lists(
    st.tuples(st.integers(0, 250), st.sampled_from("01"), st.sampled_from(["", "a", "b"]), st.sampled_from(Kind)),
    max_size=12,
)


def walk(legs: list[tuple[float, float, float, int]], y: float) -> list[Row]:
    """Legs of constant steps (dx, dy) [m], yaw and number of ticks."""
    x, rows = 0.0, [(0.0, y, 0.0, 0.0)]
    for dx, dy, yaw, ticks in legs:
        for _ in range(ticks):
            x, y = x + dx, y + dy
            rows.append((x, y, yaw, 20 * dx))
    return rows


@st.composite
def episodes(draw: st.DrawFn) -> EpisodeRecord:
    drives = {one: walk(draw(st.lists(steps, min_size=1, max_size=6)), 3.2 * int(one)) for one in "01"}
    hits = sorted(draw(contacts))
    return judged(PAIR, drives, [(tick, Contact(who, other, kind)) for tick, who, other, kind in hits])


def rescored(recorded: EpisodeRecord, about: Scenario, mode: ScoreMode) -> ScenarioResult:
    return score_episode(recorded, about, ROADS, mode, 1)


@settings(max_examples=40, deadline=None)
@given(recorded=episodes())
def test_scores_are_in_range_and_consistent(recorded: EpisodeRecord) -> None:
    """Whatever CAVs do, the recomputed criteria agree with the live judge and numbers stay in range."""
    found = rescored(recorded, PAIR, ScoreMode.MDRIVE)
    assert 0.0 <= found.ds <= 100.0
    assert 0.0 <= found.ip <= 1.0
    assert 0.0 <= found.rc <= 100.0
    assert found.ds == pytest.approx(sum(one.ds for one in found.egos) / 2, abs=1e-5)
    for one in found.egos:
        assert one.ds == pytest.approx(one.rc * one.ip, abs=1e-4)


@settings(max_examples=15, deadline=None)
@given(recorded=episodes())
def test_a_stored_episode_scores_as_the_live_one(
    recorded: EpisodeRecord, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("episode") / "e.npz"
    save_episode(recorded, path)
    for mode in ScoreMode:
        assert rescored(load_episode(path), PAIR, mode) == rescored(recorded, PAIR, mode)


kinds = st.lists(st.sampled_from(sorted(FACTORS)), max_size=4)


@given(egos=st.lists(st.tuples(kinds, st.floats(0, 100)), min_size=1, max_size=6), shuffle=st.randoms())
def test_the_order_of_the_egos_does_not_matter_to_mdrive(egos: list[tuple[list[str], float]], shuffle: object) -> None:
    records = [record(*kinds, ego_id=str(i), rc=rc) for i, (kinds, rc) in enumerate(egos)]
    before = numbers(records, "mdrive")
    shuffle.shuffle(records)  # pyright: ignore
    assert numbers(records, "mdrive") == before


# --- the file


def full_results() -> Results:
    found = score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1)
    return summarize_run(RUN, [found, make_void_result(scenario(id="e"), 1, "SUMO stopped")])


def test_results_come_back_as_they_were_saved(tmp_path: Path) -> None:
    saved = full_results()
    save_results(saved, tmp_path / "results.json")
    first = (tmp_path / "results.json").read_bytes()
    assert load_results(tmp_path / "results.json") == saved
    save_results(load_results(tmp_path / "results.json"), tmp_path / "results.json")
    assert (tmp_path / "results.json").read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_the_file_has_the_published_form(tmp_path: Path) -> None:
    save_results(full_results(), tmp_path / "results.json")
    data = json.loads((tmp_path / "results.json").read_text())
    assert list(data) == ["format", "run", "overall", "buckets", "void", "scenarios"]
    assert data["format"] == "mdrive-sumo/results/2"
    assert set(data["overall"]) == {"bucket_mean", "scenario_mean"}
    one = data["scenarios"][0]
    assert set(one) == {
        *("id", "bucket", "category", "seed", "status", "reason", "ds", "sr", "rc", "ip"),
        *("min_ttc", "digest", "ticks", "egos", "comm", "notes"),
    }
    assert set(one["egos"][0]) == {"id", "outcome", "reason", "ds", "rc", "ip", "infractions"}
    assert set(one["egos"][0]["infractions"][0]) == {"kind", "tick", "x", "y", "factor", "other"}


def test_the_schema_describes_every_key_of_the_file() -> None:
    schema = build_results_schema()
    data = full_results().model_dump(mode="json")
    assert set(schema["properties"]) == set(data)
    assert set(schema["$defs"]["ScenarioResult"]["properties"]) == set(data["scenarios"][0]) | {"scalars"}
    assert schema["$defs"]["ScenarioResult"]["additionalProperties"] is False
    assert schema["properties"]["format"]["const"] == "mdrive-sumo/results/2"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "cannot be read"),
        ("{", "expected JSON"),
        ("[1]", "results.json: "),
        ("\xff", "expected JSON"),
        (
            '{"format": "mdrive-sumo/results/9"}',
            "expected 'mdrive-sumo/results/2', found 'mdrive-sumo/results/9'",
        ),
        ("{}", "format: expected 'mdrive-sumo/results/2', found None"),
        ('{"format": "mdrive-sumo/results/2"}', "run: Field required"),
    ],
)
def test_an_unusable_file_is_refused_in_one_sentence(tmp_path: Path, text: str | None, says: str) -> None:
    path = tmp_path / "results.json"
    if text is not None:
        path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        load_results(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_keys_and_nan_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    for change in ({"more": 1}, {"void": float("nan")}):
        path.write_text(json.dumps({**full_results().model_dump(mode="json"), **change}))
        with pytest.raises(InputError):
            load_results(path)

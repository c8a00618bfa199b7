"""Leaderboards, histories and the queue, on both databases."""

from dataclasses import replace
from typing import Any

import pytest
from testing import databases
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, all_of, driven, sent, with_teams

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.report.published_results import BUCKETS
from mdrive_sumo.scenario.suite import load_suite
from server.api.leaderboards import list_published
from server.enums import ChallengeTrack, JobState, SubmissionState
from server.store import NotFound, Store, jobs, phases, queries, submissions, teams
from server.store.row_check import find_row_differences
from server.store.tables import StandingRow

WIDE = replace(PHASE, per_day=1000, in_parallel=1000, in_total=1000)


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


@pytest.fixture
def ids(store: Store) -> list[str]:
    return with_teams(store, "red", "blue", "green", phase=WIDE)


def place(store: Store, team: str, ds: float, now_us: int, sensing: str = "object", **changed: object) -> str:
    """A finished submission."""
    with store.write() as session:
        submission = sent(session, team, now_us, **changed)
        driven(session, submission, now_us, ds, sensing)
        return submission.id


def board(
    store: Store, track: ChallengeTrack | None = ChallengeTrack.SINGLE, **which: Any
) -> list[tuple[int | None, str, float]]:
    with store.read() as session:
        return [(row.rank, row.team, row.ds) for row in queries.find_leaderboard(session, PHASE.id, track, **which)]


@pytest.mark.slow
def test_the_best_of_each_team_and_ties_go_to_the_earlier(store: Store, ids: list[str]) -> None:
    red, blue, green = ids
    place(store, red, 50, NOON + 1)
    place(store, green, 70, NOON + 5)
    best = place(store, blue, 70, NOON + 3)
    place(store, blue, 70, NOON + 9)
    place(store, red, 60, NOON + 7)
    assert board(store) == [(1, "blue", 70), (2, "green", 70), (3, "red", 60)]
    with store.read() as session:
        first = queries.find_leaderboard(session, PHASE.id, ChallengeTrack.SINGLE)[0]
    assert (first.submission, first.created_us, first.method, first.figures) == (
        best,
        NOON + 3,
        "method",
        {"ds": 70, "sr": 50.0},
    )


@pytest.mark.slow
def test_a_difference_beyond_what_results_print_is_a_tie(store: Store, ids: list[str]) -> None:
    place(store, ids[0], 70.0, NOON + 1)
    place(store, ids[1], 70.0000001, NOON + 2)
    assert [team for _, team, _ in board(store)] == ["red", "blue"]


@pytest.mark.slow
def test_by_bucket_and_category(store: Store, ids: list[str]) -> None:
    place(store, ids[0], 30, NOON + 1)
    place(store, ids[1], 60, NOON + 2)
    assert board(store, bucket="interaction") == [(1, "red", 70), (2, "blue", 40)]
    assert board(store, category="merge") == [(1, "blue", 60), (2, "red", 30)]
    assert board(store, bucket="nowhere") == []
    with pytest.raises(ValueError, match="a bucket or a category"):
        board(store, bucket="interaction", category="merge")


@pytest.mark.slow
def test_sensing_tracks_are_ranked_apart_and_a_team_has_its_best_of_each(store: Store, ids: list[str]) -> None:
    red, blue, green = ids
    place(store, red, 90, NOON + 1, "object")
    place(store, red, 60, NOON + 2, "sensor")
    place(store, red, 50, NOON + 3, "sensor")
    place(store, blue, 70, NOON + 4, "sensor")
    place(store, green, 95, NOON + 5)  # of a version without tracks
    lidar = [(1, "blue", 70.0), (2, "red", 60.0)]
    listed = [(1, "green", 95.0), (2, "red", 90.0)]
    assert board(store) == listed + lidar
    assert board(store, sensing_track=SensingTrack.SENSOR) == lidar
    assert board(store, sensing_track=SensingTrack.OBJECT) == listed
    assert board(store, category="merge", sensing_track=SensingTrack.SENSOR) == lidar
    with store.read() as session:
        assert list(find_row_differences(session)) == []


@pytest.mark.slow
def test_tracks_are_apart_and_joint_agents_stand_only_in_their_own(store: Store, ids: list[str]) -> None:
    place(store, ids[0], 30, NOON + 1)
    place(store, ids[0], 40, NOON + 2, track=ChallengeTrack.SHARING)
    place(store, ids[1], 90, NOON + 3, track=ChallengeTrack.JOINT)
    assert board(store) == [(1, "red", 30)]
    assert board(store, ChallengeTrack.JOINT) == [(1, "blue", 90)]
    assert board(store, None) == [(1, "red", 40)]


def test_another_phase_is_another_board(store: Store, ids: list[str]) -> None:
    with store.write() as session:
        phases.set_phases(session, [replace(WIDE, id="test")], NOON)
    place(store, ids[0], 30, NOON + 1, phase="test")
    assert board(store) == []


@pytest.mark.slow
def test_only_results_of_the_same_evaluator_are_ranked(store: Store, ids: list[str]) -> None:
    place(store, ids[0], 99, NOON + 1)
    place(store, ids[1], 98, NOON + 2)
    newer = {"evaluator": {"version": "2"}}
    place(store, ids[0], 50, NOON + 3, **newer)
    place(store, ids[2], 60, NOON + 4, **newer)
    assert board(store) == [(1, "green", 60), (2, "red", 50), (None, "blue", 98)]


@pytest.mark.slow
def test_agents_of_two_environments_are_ranked_together(store: Store, ids: list[str]) -> None:
    for number, holds in enumerate(("numpy 1", "torch 1", "numpy 2")):
        place(store, ids[number], 50 - number, NOON + number, evaluator={"version": "1", "environment": holds})
    assert [rank for rank, _, _ in board(store)] == [1, 2, 3]


@pytest.mark.slow
def test_the_evaluator_that_finished_last_is_the_current_one(store: Store, ids: list[str]) -> None:
    """Not that of the submission sent last: an older one may have begun anew under a newer evaluator."""
    place(store, ids[0], 90, NOON + 2)
    with store.write() as session:
        renewed = sent(session, ids[1], NOON + 1, evaluator={"version": "2"})
        driven(session, renewed, NOON + 3 * S, 50)
    assert board(store) == [(1, "blue", 50), (None, "red", 90)]


@pytest.mark.slow
def test_hidden_teams_and_submissions_not_shown_are_not_there(store: Store, ids: list[str]) -> None:
    better = place(store, ids[0], 60, NOON + 1)
    place(store, ids[0], 50, NOON + 2)
    place(store, ids[1], 40, NOON + 3)
    with store.write() as session:
        submissions.set_shown(session, better, False, NOON)
        teams.set_hidden(session, ids[1], True, NOON)
    assert board(store) == [(1, "red", 50)]
    with store.write() as session:
        submissions.set_shown(session, better, True, NOON)
        teams.set_hidden(session, ids[1], False, NOON)
    assert board(store) == [(1, "red", 60), (2, "blue", 40)]


@pytest.mark.slow
def test_a_history_is_in_order_and_a_course_has_finished_ones_only(store: Store, ids: list[str]) -> None:
    place(store, ids[0], 60, NOON + 1)
    place(store, ids[0], 50, NOON + 2)
    with store.write() as session:
        sent(session, ids[0], NOON + 3)
        place_of_blue = sent(session, ids[1], NOON + 4)
    with store.read() as session:
        assert [(found.ds, found.state) for found in queries.list_history(session, ids[0], PHASE.id)] == [
            (60, "done"),
            (50, "done"),
            (None, "queued"),
        ]
        assert queries.find_score_histories(session, PHASE.id, None, ids) == {ids[0]: [60, 50]}
        assert queries.find_score_histories(session, PHASE.id, None, ids[1:]) == {}
        assert queries.find_score_histories(session, PHASE.id, ChallengeTrack.JOINT, ids) == {}
        assert [found.id for found in queries.list_history(session, ids[1], PHASE.id)] == [place_of_blue.id]


@pytest.mark.slow
def test_the_queue_knows_its_length_and_pace(store: Store, ids: list[str]) -> None:
    done = place(store, ids[0], 60, NOON + 1)
    with store.write() as session:
        older = sent(session, ids[0], NOON + 2)
        newer = sent(session, ids[1], NOON + 3, jobs=[("a", n) for n in range(3)])
        job = jobs.claim(session, "w", LEASE, NOON)
        assert job is not None and job.submission == older.id
        jobs.finish(session, job.id, "w", 1, GOOD, NOON + 4 * S)
    with store.read() as session:
        mean_us = (S + S + 4 * S) // 3
        assert queries.find_queue_position(session, newer.id) == queries.QueuePosition(2, 4, mean_us)
        assert queries.find_queue_position(session, older.id) == queries.QueuePosition(1, 1, mean_us)
        assert queries.find_queue_position(session, done) == queries.QueuePosition(0, 0, mean_us)
        assert queries.count_jobs(session, older.id) == {JobState.DONE: 1, JobState.QUEUED: 1}
        assert queries.count_by_state(session) == (
            {SubmissionState.DONE: 1, SubmissionState.RUNNING: 1, SubmissionState.QUEUED: 1},
            {JobState.DONE: 3, JobState.QUEUED: 4},
        )
        with pytest.raises(NotFound):
            queries.find_queue_position(session, "x")


def test_the_pace_is_unknown_at_first(store: Store, ids: list[str]) -> None:
    with store.write() as session:
        assert queries.find_queue_position(session, sent(session, ids[0]).id) == queries.QueuePosition(1, 2, None)


@pytest.mark.slow
def test_a_leaderboard_costs_what_it_shows(ids: list[str], store: Store) -> None:
    """However many submissions there are, one line of each team, track and part of the suite is kept."""
    for number in range(4):
        place(store, ids[0], 50 + number, NOON + number)
    with store.read() as session:
        standings = all_of(session, StandingRow)
    assert sorted((row.slice, row.ds) for row in standings) == [
        ("bucket:interaction", 50),
        ("bucket:interdrive", 53),
        ("category:merge", 53),
        ("overall", 53),
    ]


def test_published_rows_are_marked_and_unranked() -> None:
    rows = list_published(None)
    assert [(row.method, row.ds) for row in rows[:2]] == [("CoDriving", 82.67), ("CoLMDriver", 77.16)]
    assert all(row.published and row.rank is None and row.submission is None for row in rows) and len(rows) == 7
    assert [row.method for row in list_published(ChallengeTrack.NEGOTIATION, bucket="InterDrive")] == [
        "CoLMDriver",
        "CoLMDriver (rule-based)",
    ]
    assert list_published(ChallengeTrack.NEGOTIATION, bucket="InterDrive")[0].figures == {
        "ds": 85.29,
        "sr": 76.85,
    }
    assert (
        list_published(None, category="merge")
        == list_published(None, bucket="mine")
        == list_published(ChallengeTrack.JOINT)
        == []
    )


def test_published_buckets_are_named_as_in_scenarios() -> None:
    assert {scenario.bucket for scenario in load_suite("interdrive@0").scenarios} <= set(BUCKETS)


def test_published_averages_are_the_means_of_their_buckets() -> None:
    """Against misprints: the paper's average is the mean of the three to its two decimals."""
    for overall in list_published(None):
        for figure in ("ds", "sr"):
            parts = [
                row.figures[figure]
                for bucket in BUCKETS
                for row in list_published(None, bucket=bucket)
                if row.method == overall.method
            ]
            assert overall.figures[figure] == pytest.approx(sum(parts) / 3, abs=0.0101), (overall.method, figure)

"""What a submission can learn of a hidden phase is bounded: few digits, and ranks that disclose no more."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import select
from testing.api_app import HIDDEN, Server, another_zip
from testing.store_samples import GOOD, LEASE, PHASE, S, summary
from testing.web_page import Visit

from mdrive_sumo.scoring.metrics import list_scalar_metrics
from server.api import submission_views
from server.api.schemas.submissions import FiguresOut
from server.store import jobs, standings, submissions, tables
from server.store.phases import set_phases

pytestmark = pytest.mark.slow

FIGURES = [name for name in FiguresOut.model_fields if name not in ("timed", "scenarios", "infractions", "scalars")]
SCALAR_NAMES = [metric.name for metric in list_scalar_metrics()]
SCALARS = st.dictionaries(st.sampled_from(SCALAR_NAMES), st.floats(0, 100))


def finish(server: Server, submission: str, ds: float) -> None:
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "w", job.attempt, GOOD, server.now_us)
        assert submissions.finish_if_complete(session, submission, summary(ds), server.now_us)


@given(
    ds=st.floats(0, 100),
    sr=st.floats(0, 100),
    more=st.dictionaries(st.sampled_from(FIGURES), st.floats(0, 100)),
    scalars=SCALARS,
)
def test_a_hidden_result_carries_at_most_17_bits(
    ds: float, sr: float, more: dict[str, float], scalars: dict[str, float]
) -> None:
    """The bound of docs/api.md: 1001 values of DS times 101 of SR."""
    overall = {"scenarios": 20, "scalars": scalars} | more | {"ds": ds, "sr": sr}
    stored = {"overall": overall, "buckets": {"A": overall}, "categories": {"merge": overall}}
    shown = submission_views.visible_summary(tables.PhaseRow(public=False), stored)
    assert shown is not None and shown.overall.sr is not None
    assert shown.overall.ds in [round(step / 10, 1) for step in range(1001)]
    assert shown.overall.sr in range(101)
    assert math.log2(1001 * 101) < 17
    kept = {"ds", "sr", "scenarios"}
    assert not any(shown.overall.model_dump(exclude=kept).values())
    assert not shown.buckets and not shown.categories


def test_scalars_of_a_hidden_phase_are_nowhere(server: Server) -> None:
    """Speeds and message rates are what an agent chooses most freely: each would carry some 20 bits."""
    with server.store.write() as session:
        set_phases(session, [PHASE, replace(HIDDEN, per_day=50, in_parallel=50)], 0)
    mine = server.send("red", phase=HIDDEN.id).json()["id"]
    figures = {"ds": 50.0, "sr": 50.0, "scalars": dict.fromkeys(SCALAR_NAMES, 7.654321)}
    parts = {"buckets": {"A": figures}, "categories": {"merge": figures}}
    everything = summary(50.0) | {"overall": figures} | parts
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "w", job.attempt, GOOD, server.now_us)
        assert submissions.finish_if_complete(session, mine, everything, server.now_us)
    server.now_us += 60 * S
    boards = [f"/?phase={HIDDEN.id}&columns=beside&sort={sort}" for sort in ("rank", "mean_speed")]
    for who in ("", "red"):
        for place in (f"/submissions/{mine}", f"/leaderboards/{HIDDEN.id}"):
            answer = server.ask("GET", place, who)
            assert answer.status_code == 200 and "7.65" not in answer.text, (who, place)
        for place in (f"/submissions/{mine}", f"/leaderboard.csv?phase={HIDDEN.id}", *boards):
            answer = Visit(server, who).client.get(place)
            assert answer.status_code == 200 and "7.6" not in answer.text and "7.7" not in answer.text, (who, place)
    shown = server.get(f"/submissions/{mine}", "admin")
    assert shown["summary"]["overall"]["scalars"]["comfort"] == 7.654321  # admins see everything


def test_ranks_disclose_no_more_digits(server: Server) -> None:
    """An attack: the better of one's own submissions is on the board, the better of two teams above."""
    with server.store.write() as session:
        set_phases(session, [replace(HIDDEN, per_day=50, in_parallel=50)], 0)
    sent: dict[str, str] = {}
    for number, (team, ds) in enumerate((("blue", 50.0123), ("red", 50.0456), ("red", 50.0499))):
        server.now_us += S
        mine = server.send(team, data=another_zip(number), phase=HIDDEN.id).json()["id"]
        sent[f"{team} {ds}"] = mine
        finish(server, mine, ds)
    server.now_us += 60 * S
    rows = server.get(f"/leaderboards/{HIDDEN.id}")["rows"]
    found = [(row["rank"], row["submission"]) for row in rows]
    assert found == [(1, sent["blue 50.0123"]), (2, sent["red 50.0456"])]  # the earlier ones


def test_standings_follow_a_phase_that_becomes_hidden(server: Server) -> None:
    mine = server.send().json()["id"]
    finish(server, mine, 55.512345)

    def scores() -> set[float]:
        with server.store.read() as session:
            overall = select(tables.StandingRow.ds).where(tables.StandingRow.slice == "overall")
            return set(session.scalars(overall))

    for public, expected in ((True, {55.512345}), (False, {55.5}), (True, {55.512345})):
        with server.store.write() as session:
            set_phases(session, [replace(PHASE, public=public)], 0)
            standings.refresh_scores(session)
        assert scores() == expected

"""The page of cross-play: matrix, the score with strangers, CSV, and who may see it."""

import csv
import io
from pathlib import Path

import pytest
from testing.api_app import HIDDEN, Server
from testing.store_samples import PHASE
from testing.web_page import Visit, driven, links

from server.enums import JobKind, JobState
from server.store import cross_play, phases, standings, submissions
from server.store.tables import JobRow

SCORE = {"sr": 0.0, "tested_failed": "", "others_failed": ""}


@pytest.fixture
def server(tmp_path: Path) -> Server:
    made = Server(tmp_path)
    with made.store.write() as session:
        for phase in (PHASE.id, HIDDEN.id):
            phases.get(session, phase).cross_play_scenarios = 2
    return made


def put(server: Server, tested: str, others: str, *results: dict[str, object]) -> None:
    """Finished jobs of a pair."""
    with server.store.write() as session:
        evaluator = standings.evaluator_digest(submissions.get(session, tested).evaluator)
        session.add_all(
            JobRow(
                kind=JobKind.CROSS_PLAY.value,
                submission=tested,
                others=others,
                evaluator=evaluator,
                scenario=f"s{number}",
                seed=cross_play.SEED,
                state=JobState.DONE.value,
                result=SCORE | result,
            )
            for number, result in enumerate(results)
        )


@pytest.mark.slow
def test_the_matrix_names_each_pair_and_whose_agent_failed(server: Server) -> None:
    visit = Visit(server)
    assert "No pairs yet" in visit.get("/cross-play?phase=dev").words
    red, blue = driven(server, "red", 80.0, "object"), driven(server, "blue", 90.0, "sensor", name="by lidar")
    put(server, red, blue, {"ds": 40.0}, {"ds": 60.0, "tested_failed": "crashed: exit"})
    stopped = {"ds": 50.0, "others_failed": "crashed: text", "by_messages": True}
    put(server, blue, red, {"ds": 90.0}, {"ds": 10.0, "others_failed": "timeout: act"}, stopped)
    page = visit.get("/cross-play?phase=dev")
    assert "/cross-play?phase=dev" in links(visit.get("/?phase=dev"))
    assert "Object track, ranked apart" in page.words and "Sensor track, ranked apart" in page.words
    assert "50.0 failed" in page.words and "70.0 stopped others (2 of 3)" in page.words
    rows = list(csv.DictReader(io.StringIO(visit.client.get("/cross-play.csv?phase=dev").text)))
    assert [(row["team"], row["others_team"], row["ds"], row["stopped_others"], row["left_out"]) for row in rows] == [
        ("red", "blue", "50.0", "0", "0"),
        ("blue", "red", "70.0", "1", "1"),
    ]
    board = visit.client.get("/api/v1/phases/dev/cross-play").json()
    assert [(agent["team"], agent["ds"], agent["alone_ds"]) for agent in board["agents"]] == [
        ("red", 50.0, 80.0),
        ("blue", 70.0, 90.0),
    ]


@pytest.mark.slow
def test_of_hidden_phases_and_phases_without_it_nothing_is_shown(server: Server) -> None:
    visit = Visit(server)
    assert "/cross-play?phase=test" not in links(visit.get("/?phase=test"))
    assert visit.client.get("/cross-play?phase=test").status_code == 403
    assert visit.client.get("/api/v1/phases/test/cross-play").status_code == 403
    assert server.get("/phases/test/cross-play", "admin")["agents"] == []
    assert visit.client.get("/cross-play?phase=past").status_code == 404
    assert visit.client.get("/cross-play?phase=no").status_code == 404
    assert "/cross-play?phase=past" not in links(visit.get("/?phase=past"))

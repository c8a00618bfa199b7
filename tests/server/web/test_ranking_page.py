"""The page of the ranking by item response: ranks by track, CSV and JSON, and nothing of hidden phases."""

import csv
import io
from pathlib import Path

import pytest
from testing.api_app import Server
from testing.store_samples import NOON
from testing.web_page import Visit, driven, links

from server.enums import TokenScope
from server.store import teams, tokens


@pytest.fixture
def server(tmp_path: Path) -> Server:
    made = Server(tmp_path)
    with made.store.write() as session:
        green = teams.create(session, "green", NOON)
        made.tokens["green"] = tokens.issue(session, green, TokenScope.SUBMIT, NOON)
    return made


@pytest.mark.slow
def test_agents_are_ranked_by_track(server: Server) -> None:
    visit = Visit(server)
    assert "No ranking yet" in visit.get("/ranking?phase=dev").words
    for team, ds, track in (("red", 80.0, "object"), ("blue", 90.0, "sensor"), ("green", 60.0, "object")):
        driven(server, team, ds, track)
    assert "/ranking?phase=dev" in links(visit.get("/?phase=dev"))
    page = visit.get("/ranking?phase=dev")
    assert "Object track, ranked apart" in page.words and "Sensor track, ranked apart" in page.words
    rows = list(csv.DictReader(io.StringIO(visit.client.get("/ranking.csv?phase=dev").text)))
    assert [(row["team"], row["rank"], row["ds"], row["rank_low"]) for row in rows] == [
        ("red", "1", "80.0", ""),
        ("green", "2", "60.0", ""),
        ("blue", "1", "90.0", ""),
    ]
    ranking = visit.client.get("/api/v1/phases/dev/ranking").json()
    assert ranking["scenarios"] == 2 and ranking["agents"][0]["ability"] > ranking["agents"][1]["ability"]


@pytest.mark.slow
def test_of_hidden_phases_nothing_is_shown(server: Server) -> None:
    visit = Visit(server)
    assert visit.client.get("/ranking?phase=test").status_code == 403
    assert visit.client.get("/api/v1/phases/test/ranking").status_code == 403
    assert "/ranking?phase=test" not in links(visit.get("/?phase=test"))
    assert visit.client.get("/ranking?phase=no").status_code == 404

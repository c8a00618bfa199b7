"""A team's page: who sees what of it, and what its members do there; and names of strangers."""

from pathlib import Path

import pytest
from testing.api_app import Server, another_zip, problem
from testing.store_samples import NOON
from testing.web_page import Visit, driven, first_table, links, sound

from server.api.leaderboard_cache import STALE_US
from server.clock import DAY_US
from server.enums import TokenScope
from server.store import audit, teams, tokens
from server.web.visitor import COOKIE

HOSTILE = "<script>alert(1)</script>"
"""As a name of a team or of a method."""


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


@pytest.mark.slow
def test_names_of_strangers_are_text(server: Server) -> None:
    with server.store.write() as session:
        hostile = teams.create(session, HOSTILE, NOON)
        server.tokens["hostile"] = tokens.issue(session, hostile, TokenScope.SUBMIT, NOON)
    driven(server, "hostile", 41.0, name='"><img src=x onerror=alert(1)>')
    for path in ("/?phase=dev", f"/teams/{hostile.id}", f"/?phase=dev&sort={HOSTILE}", f"/{HOSTILE}"):
        answer = Visit(server, "hostile").client.get(path)
        assert "<script>alert" not in answer.text and "<img" not in answer.text
        sound(answer)
    page = Visit(server, "hostile").get(f"/teams/{hostile.id}")
    assert page.all("h1")[0].text == HOSTILE


@pytest.mark.slow
def test_teams_see_their_own_and_others_what_is_shown(server: Server) -> None:
    shown, kept = driven(server, "red", 41.0, name="shown one"), driven(server, "red", 30.0, name="kept one")
    server.ask("PUT", f"/submissions/{kept}/shown", "red", json={"shown": False})
    server.send("red", another_zip(7), phase="test", name="waiting one")
    for who in ("", "blue"):
        page = Visit(server, who).get("/teams/red")
        assert "shown one" in page.words and f"/submissions/{shown}" in links(page)
        for secret in ("kept one", "waiting one", "All submissions", "Tokens"):
            assert secret not in page.words
    for who in ("red", "admin"):
        page = Visit(server, who).get(f"/teams/{server.red}")
        for word in ("kept one", "waiting one", "queued", "place 1", "Tokens"):
            assert word in page.words, word
    assert "1 left today, 2 at a time, 98 in total" in Visit(server, "red").get("/teams/red").words
    assert "no 'nobody'" in Visit(server).get("/teams/nobody", 404).words


@pytest.mark.slow
def test_a_hidden_team_is_hidden(server: Server) -> None:
    driven(server, "red", 41.0)
    with server.store.write() as session:
        teams.set_hidden(session, server.red, True, NOON)
    for who in ("", "blue"):
        Visit(server, who).get("/teams/red", 404)
    assert "hidden" in Visit(server, "red").get("/teams/red").words
    server.now_us += STALE_US
    assert "red" not in first_table(Visit(server).get("/?phase=dev"))


@pytest.mark.slow
def test_the_history_is_drawn_and_said(server: Server) -> None:
    driven(server, "red", 41.0)
    server.now_us += DAY_US
    driven(server, "red", 60.0)
    drawn = Visit(server).get("/teams/red").all("svg", class_="history")[0]
    assert drawn.attributes["aria-label"] == (
        "Driving score over time, 2 submissions: 41.0 on 2024-10-04, 60.0 on 2024-10-05, best 60.0"
    )
    assert "method: DS 60.0, 2024-10-05" in drawn.text
    driven(server, "red", 99.0, track="negotiation")
    page = Visit(server).get("/teams/red")
    lines = [each.attributes["points"].split() for each in page.all("polyline", class_="draw-line")]
    assert [len(line) for line in lines] == [2, 1], "results of different tracks are not joined"


@pytest.mark.slow
def test_a_team_chooses_what_is_shown(server: Server) -> None:
    mine = driven(server, "red", 41.0)
    Visit(server, "blue").post(f"/teams/{server.blue}/shown", 404, submission=mine, shown="false")
    Visit(server).post(f"/teams/{server.red}/shown", 401, submission=mine, shown="false")
    assert first_table(Visit(server).get("/?phase=dev")) == ["red"]
    answer = Visit(server, "red").post(f"/teams/{server.red}/shown", submission=mine, shown="false")
    assert answer.headers["location"] == f"/teams/{server.red}#submissions"
    assert "No submissions yet" in Visit(server).get("/?phase=dev").words


@pytest.mark.slow
def test_a_team_revokes_its_tokens(server: Server) -> None:
    with server.store.write() as session:
        spare = tokens.issue(session, teams.get(session, "red"), TokenScope.SUBMIT, NOON)
        ids = {scope: found.id for scope, text in (("spare", spare), *server.tokens.items())
               if (found := tokens.find_token(session, text))}  # fmt: skip
    red = Visit(server, "red")
    for token in (ids["blue"], ids["admin"], "0" * 32):
        red.post(f"/teams/{server.red}/revoke", 404, token=token)
        Visit(server, "blue").post(f"/teams/{server.red}/revoke", 404, token=ids["red"])
    red.post(f"/teams/{server.red}/revoke", token=ids["spare"])
    assert "revoked" in red.get("/teams/red").words
    answer = red.post(f"/teams/{server.red}/revoke", token=ids["red"])
    assert answer.headers["location"] == "/login" and f'{COOKIE}="";' in answer.headers["set-cookie"]
    problem(server.ask("GET", "/me", "red"), 401)
    with server.store.read() as session:
        last = session.query(audit.AuditEntryRow).order_by(audit.AuditEntryRow.id.desc()).first()
        assert last is not None and (last.action, last.actor) == ("token-revoked", f"submit:{server.red}")

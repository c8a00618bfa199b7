"""Pages over several submissions, tokens and the webhook on the team's page, and what empty pages say."""

import csv
import io
from pathlib import Path

import pytest
from testing.api_app import HIDDEN, Server
from testing.store_samples import NOON
from testing.web_page import Visit, driven, links, sound

from server.enums import TokenScope
from server.settings import WebhookSettings
from server.store import teams, tokens

pytestmark = pytest.mark.slow


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def test_two_submissions_side_by_side(server: Server) -> None:
    a, b = driven(server, "red", 41.0, name="<old>"), driven(server, "blue", 60.5, name="new")
    assert f"/submissions/{a}/compare" in links(Visit(server).get(f"/submissions/{a}"))
    choice = Visit(server).get(f"/submissions/{a}/compare")
    assert [each.attributes["value"] for each in choice.all("option")] == [b]
    page = Visit(server).get(f"/submissions/{a}/compare?other={b}")
    assert "A: <old> of red" in page.words and "B: new of blue" in page.words
    assert page.all("b", id="difference")[0].text == "+19.5" and "too few for an interval" in page.words
    assert "+19.5" in page.words and f"/submissions/{a}/scenarios/left-turn/0" in links(page)
    back = Visit(server).get(f"/submissions/{b}/compare?other={a}")
    assert back.all("b", id="difference")[0].text == "−19.5" and len(back.all("td", class_="loss")) == 2
    assert "found the same twice" in Visit(server).get(f"/submissions/{a}/compare?other={a}", 422).words


def test_of_a_hidden_phase_two_rounded_scores_are_compared(server: Server) -> None:
    a, b = (driven(server, "red", ds, phase=HIDDEN.id) for ds in (41.125, 41.375))
    page = Visit(server, "red").get(f"/submissions/{a}/compare?other={b}")
    assert "41.1" in page.words and "41.4" in page.words and "The scenarios of this phase are hidden" in page.words
    assert "left-turn" not in page.words and not page.all("b", id="difference")
    assert len(Visit(server, "admin").get(f"/submissions/{a}/compare?other={b}").all("tr")) > 4


def test_nothing_to_compare_with_says_what_to_do(server: Server) -> None:
    mine = driven(server, "red", 41.0)
    assert "Submit another agent" in Visit(server).get(f"/submissions/{mine}/compare").words
    Visit(server).get(f"/submissions/{'0' * 32}/compare", 404)


def test_scenarios_are_downloaded(server: Server) -> None:
    mine = driven(server, "red", 41.0)
    (link,) = links(Visit(server).get(f"/submissions/{mine}"), f"/submissions/{mine}/scenarios.csv")
    for who, control in (("", "no-cache"), ("red", "no-store")):
        answer = Visit(server, who).client.get(link)
        assert answer.headers["cache-control"] == control and answer.headers["vary"] == "Cookie"
        assert [row["ds"] for row in csv.DictReader(io.StringIO(answer.text))] == ["41.0", "41.0"]
    hidden = driven(server, "red", 41.0, phase=HIDDEN.id)
    assert not links(Visit(server, "red").get(f"/submissions/{hidden}"), f"/submissions/{hidden}/scenarios.csv")
    assert Visit(server, "red").client.get(f"/submissions/{hidden}/scenarios.csv").status_code == 403


def test_search(server: Server) -> None:
    mine = driven(server, "red", 41.0, name="<b>Planner")
    assert Visit(server).get("/?phase=dev").all("form", role="search")[0].attributes["action"] == "/search"
    page = Visit(server).get("/search?q=%3CB%3Eplan")
    assert "<b>Planner" in page.words and f"/submissions/{mine}" in links(page)
    assert f"/teams/{server.red}" in links(Visit(server).get("/search?q=red"))
    assert "No team has “nothing”" in Visit(server).get("/search?q=nothing").words
    for text in ("a", "a%00b"):
        assert "Enter 2 to 80" in Visit(server).get(f"/search?q={text}").words


def test_the_matrix_is_for_admins(server: Server) -> None:
    low, high = driven(server, "red", 41.0), driven(server, "blue", 100.0)
    for who in ("", "red", "worker"):
        assert "there is nothing here" in Visit(server, who).get("/admin/matrix?phase=dev", 404).words
        assert Visit(server, who).client.get("/admin/matrix.csv?phase=dev").status_code == 404
    admin = Visit(server, "admin")
    page = admin.get("/admin/matrix?phase=dev")
    assert {f"/submissions/{low}", f"/submissions/{high}"} <= set(links(page))
    assert [each.text for each in page.all("td", class_="loss")] == ["41.0", "41.0"]
    assert [each.text for each in page.all("td", class_="gain")] == ["100.0", "100.0"]
    for order in ("ds", "failed"):
        sorted_by = admin.get(f"/admin/matrix?phase=dev&sort={order}").all("th", scope="col")
        assert [each.text.strip() for each in sorted_by if "aria-sort" in each.attributes] == [
            {"ds": "Mean", "failed": "Failed"}[order]
        ]
    (link,) = links(page, "/admin/matrix.csv")
    answer = admin.client.get(link)
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert [(row["scenario"], row["red"], row["blue"]) for row in rows] == [
        ("left-turn", "41.0", "100.0"), ("merge", "41.0", "100.0"),
    ]  # fmt: skip
    assert answer.headers["cache-control"] == "no-store"
    assert "No shown results" in admin.get("/admin/matrix?phase=past").words
    assert "for organisers only" in admin.get("/admin/matrix").words, "the phase that opened last is hidden"
    admin.get("/admin/matrix?phase=nope", 404)
    admin.get("/admin/matrix?phase=dev&sort=x", 422)


def test_a_member_makes_a_token(server: Server) -> None:
    red = Visit(server, "red")
    page = sound(red.post(f"/teams/{server.red}/tokens", 200))
    bearer = {"Authorization": f"Bearer {page.all('input', id='issued')[0].attributes['value']}"}
    assert server.client.get("/api/v1/me", headers=bearer).json()["team"]["name"] == "red"
    for who, team, status in (("blue", server.red, 404), ("worker", server.red, 404), ("", server.red, 401)):
        Visit(server, who).post(f"/teams/{team}/tokens", status)
    with server.store.write() as session:
        for _ in range(18):
            tokens.issue(session, teams.get(session, "red"), TokenScope.SUBMIT, NOON)
    assert "fewer than 20 valid" in sound(red.post(f"/teams/{server.red}/tokens", 422)).words


def test_a_revocation_is_confirmed(server: Server) -> None:
    with server.store.read() as session:
        ids = {who: found.id for who, text in server.tokens.items() if (found := tokens.find_token(session, text))}
    red, admin = Visit(server, "red"), Visit(server, "admin")
    asked = f"/teams/{server.red}/tokens/{ids['red']}/revoke"
    assert asked in links(red.get("/teams/red")), "no button revokes at once"
    assert not [each for each in red.get("/teams/red").all("form") if "revoke" in each.attributes.get("action", "")]
    page = red.get(asked)
    assert "You will be logged out" in page.words and "only valid token of the team" in page.words
    assert f"/teams/{server.red}#tokens" in links(page) and server.ask("GET", "/me", "red").status_code == 200
    for who, token, status in (("blue", "red", 404), ("red", "blue", 404), ("red", "admin", 404), ("", "red", 401)):
        Visit(server, who).get(f"/teams/{server.red}/tokens/{ids[token]}/revoke", status)
    listed = admin.get("/admin/teams")
    assert f"/admin/tokens/{ids['worker']}/revoke" in links(listed)
    assert not [each for each in listed.all("form") if "revoke" in each.attributes.get("action", "")]
    assert "the scope worker" in admin.get(f"/admin/tokens/{ids['worker']}/revoke").words
    red.get(f"/admin/tokens/{ids['worker']}/revoke", 404)
    (form,) = [each for each in page.all("form") if "revoke" in each.attributes["action"]]
    red.post(form.attributes["action"], token=ids["red"])
    assert server.ask("GET", "/me", "red").status_code == 401
    assert "It was revoked" in admin.get(f"/admin/tokens/{ids['red']}/revoke").words


def test_the_webhook_of_a_team(server: Server) -> None:
    red, path = Visit(server, "red"), f"/teams/{server.red}/webhook"
    secret = sound(red.post(path, 200, url="https://ci.example/hook")).all("input", id="issued")[0].attributes["value"]
    assert secret.startswith("whsec_") and secret not in red.get("/teams/red").words
    assert "https://ci.example/hook" in red.get("/teams/red").words
    for who in ("admin", "blue", ""):
        assert "https://ci.example" not in Visit(server, who).get("/teams/red").words
    mine = server.send("red").json()["id"]
    server.ask("POST", f"/submissions/{mine}/cancel", "red")
    assert f"{mine[:8]}waiting0–" in red.get("/teams/red").words
    assert "expected a public address" in sound(red.post(path, 422, url="https://127.0.0.1/")).words
    for who, status in (("blue", 404), ("admin", 403), ("worker", 403), ("", 401)):
        Visit(server, who).post(path, status, url="https://ci.example/other")
        Visit(server, who).post(f"{path}/remove", status)
    red.post(f"{path}/remove")
    assert "https://ci.example" not in red.get("/teams/red").words
    object.__setattr__(server.settings, "webhooks", WebhookSettings())
    assert not red.get("/teams/red").all("h2", id="webhook"), "this server sends none"


def test_empty_pages_name_the_next_step(server: Server) -> None:
    page = Visit(server).get("/?phase=dev&track=negotiation")
    assert "Agents of teams drive connected automated vehicles" in page.words and "/how" in links(page)
    assert "mdrive-sumo submit my_team --phase dev --track negotiation" in page.words
    assert "submit --dry-run my_team" in Visit(server).get("/?phase=past").words
    assert "Next: submit an agent" in Visit(server, "red").get("/teams/red").words
    assert "as soon as the team submits" in Visit(server, "admin").get("/teams/red").words

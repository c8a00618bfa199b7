"""The API: who may do what, and what it says when it says no."""

import pytest
from sqlalchemy import update
from testing.api_app import API, Server, problem
from testing.api_client import Client
from testing.store_samples import NOON, S

from server.store import StoreUnavailable, audit, tables, workers

JSON = {"Content-Type": "application/json"}


def test_health_says_when_the_database_is_away(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    assert server.get("/health")["status"] == "ok"

    def away() -> None:
        raise StoreUnavailable("host db7 refuses")

    monkeypatch.setattr(server.store, "version", away)
    found = server.ask("GET", "/health")
    assert "db7" not in problem(found, 503, "database")["detail"]
    assert found.headers["retry-after"] == "5"


def test_admins_make_teams_and_tokens(server: Server) -> None:
    team = server.ask("POST", "/teams", "admin", json={"name": "green"}).json()
    token = server.ask("POST", "/tokens", "admin", json={"team": "green"}).json()["token"]
    server.tokens["green"] = token
    assert server.get("/me", "green") == {"scope": "submit", "team": team}
    assert [each["name"] for each in server.get("/teams", "admin")["items"]] == ["blue", "green", "red"]
    listed = server.get("/teams/green/tokens", "admin")["items"]
    assert token not in str(listed) and len(listed) == 1
    assert server.ask("DELETE", f"/tokens/{listed[0]['id']}", "admin").status_code == 204
    problem(server.ask("GET", "/me", "green"), 401, "revoked")
    assert server.get(f"/teams/{team['id']}/tokens", "admin")["items"][0]["revoked"] is not None
    problem(server.ask("POST", "/teams", "admin", json={"name": "green"}), 422, "taken")
    problem(server.ask("POST", "/tokens", "admin", json={"scope": "submit"}), 422, "a team")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("GET", "/teams", None),
        ("POST", "/teams", {"name": "x"}),
        ("PUT", "/teams/red/hidden", {"hidden": True}),
        ("GET", "/teams/red/tokens", None),
        ("POST", "/tokens", {"scope": "admin"}),
        ("DELETE", f"/tokens/{'0' * 32}", None),
        ("POST", f"/submissions/{'0' * 32}/disqualify", {"reason": "x"}),
        ("POST", f"/submissions/{'0' * 32}/rerun", None),
        ("GET", "/audit", None),
        ("GET", "/metrics", None),
    ],
)
def test_what_is_for_admins_only(server: Server, method: str, path: str, body: object) -> None:
    answer = server.ask(method, path, json=body)
    problem(answer, 401, "Authorization")
    assert answer.headers["www-authenticate"] == "Bearer"
    problem(server.ask(method, path, "red", json=body), 403, "scope")


@pytest.mark.slow
@pytest.mark.parametrize("header", ["Bearer mdrive_nonsense", "Bearer ", "Basic cmVkOnJlZA==", "bearer \xff"])
def test_a_wrong_token_is_refused_even_where_none_is_needed(server: Server, header: str) -> None:
    headers = {"Authorization": header.encode("latin-1")}
    problem(server.client.get(f"{API}/submissions/{'0' * 32}", headers=headers), 401, "token")


def test_a_worker_sees_the_metrics_and_no_more(server: Server) -> None:
    text = server.ask("GET", "/metrics", "worker").text
    assert 'mdrive_submissions{state="queued"} 0.0' in text
    problem(server.ask("GET", "/teams", "worker"), 403, "admin")
    problem(server.send("worker"), 403, "submit")


def test_metrics_count_workers_that_live_and_spot_checks_that_differ(server: Server) -> None:
    text = server.ask("GET", "/metrics", "worker").text
    assert "mdrive_workers 0.0" in text and "mdrive_spot_check_differences 0.0" in text
    with server.store.write() as session:
        for owner, age_s in (("alive", 5), ("a lease old", 60), ("silent", 61)):
            workers.record_heartbeat(session, owner, "", server.now_us - age_s * S)
        for same in (True, False, False):
            audit.add_entry(session, "server", "spot-check", {"same": same}, server.now_us)
        audit.add_entry(session, "server", "another", {"same": False}, server.now_us)
    text = server.ask("GET", "/metrics", "worker").text
    assert "mdrive_workers 2.0" in text and "mdrive_spot_check_differences 2.0" in text


def test_phases_say_whether_they_are_open_and_hide_where_suites_lie(server: Server) -> None:
    found = {each["id"]: each for each in server.get("/phases")["items"]}
    assert [found[name]["open"] for name in ("dev", "test", "past")] == [True, True, False]
    assert found["dev"]["suite"] == "interdrive@0" and found["test"]["suite"] is None
    assert server.get("/phases/dev") == found["dev"]
    problem(server.ask("GET", "/phases/nope"), 404, "dev", "'nope'")
    problem(server.ask("GET", "/phases/NOPE"), 422, "path phase")
    assert server.get("/phases/dev/quota", "red") == {"today": 0, "in_parallel": 0, "in_total": 0}
    problem(server.ask("GET", "/phases/dev/quota", "admin"), 403, "submit")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "path", "more", "status", "word"),
    [
        ("GET", "/nothing", {}, 404, "nothing at GET"),
        ("PATCH", "/teams", {}, 405, "PATCH"),
        ("POST", "/teams", {"content": b"{", "headers": JSON}, 422, "JSON"),
        ("POST", "/teams", {"json": {}}, 422, "body name: expected a value, found none"),
        ("POST", "/teams", {"json": {"name": 5}}, 422, "found 5"),
        ("POST", "/teams", {"json": {"name": "a\nb"}}, 422, "printable"),
        ("POST", "/teams", {"json": {"name": "a", "more": 1}}, 422, "more"),
        ("POST", "/teams", {"headers": JSON, "content": b'{"name": "\\ud800"}'}, 422, "name"),
        ("PUT", "/teams/nobody/hidden", {"json": {"hidden": True}}, 404, "'nobody'"),
        ("DELETE", f"/tokens/{'0' * 32}", {}, 404, "token"),
        ("POST", "/teams", {"content": b"[" * 70_000, "headers": JSON}, 413, "at most 65536 bytes"),
        ("DELETE", "/tokens/%00", {}, 422, "token"),
        ("GET", "/teams/%00/tokens", {}, 422, "printable"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(
    server: Server, method: str, path: str, more: dict[str, object], status: int, word: str
) -> None:
    problem(server.ask(method, path, "admin", **more), status, word)


def test_what_breaks_here_is_a_problem_without_details(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise RuntimeError("secret of the house")

    monkeypatch.setattr(server.store, "version", broken)
    answer = Client(server.app, raise_server_exceptions=False).get(f"{API}/health")
    assert "secret" not in problem(answer, 500, "internal error")["detail"]


def test_a_full_disk_is_no_fault_of_the_client(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "/srv/mdrive/archives/x")

    monkeypatch.setattr("pathlib.Path.open", full)
    assert "/srv" not in problem(server.send(), 503, "No space left")["detail"]


def test_the_audit_log_is_walked(server: Server) -> None:
    found = server.get("/audit", "admin")
    assert found["entries"] == 9 and found["broken"] is None  # 3 phases, 2 teams, 4 tokens
    assert found["differences"] == []
    with server.store.write() as session:
        session.execute(update(tables.TeamRow).where(tables.TeamRow.name == "blue").values(name="green"))
    assert server.get("/audit", "admin")["differences"] == [
        f"teams {server.blue}: name: expected 'blue', found 'green'"
    ]


def test_a_hidden_team_is_nowhere(server: Server) -> None:
    assert server.get("/leaderboards/dev/teams/red")["items"] == []
    assert server.ask("PUT", "/teams/red/hidden", "admin", json={"hidden": True}).json()["hidden"]
    problem(server.ask("GET", "/leaderboards/dev/teams/red"), 404, "'red'")
    assert server.now_us == NOON and S == 1_000_000

"""The pages of admins: what they show, what they do, and that nobody else has them."""

from pathlib import Path

import pytest
from testing import databases
from testing.api_app import Server, another_zip
from testing.store_samples import LEASE, NOON, S
from testing.web_page import Visit, sound, without_ids
from testing.web_scenes import finish, sent

from mdrive_sumo.agent_process import sandbox
from mdrive_sumo.agent_process.sandbox import SandboxLayer
from server.store import audit, jobs, tables, workers

PAGES = ("/admin", "/admin/machine", "/admin/teams")
LAYERS = (
    SandboxLayer("namespaces", True, "bubblewrap"),
    SandboxLayer("seccomp", False, "no filter"),
    SandboxLayer("own-kernel", False, "none"),
)


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path / "data", databases.emptied("sqlite"))


@pytest.fixture
def admin(server: Server, monkeypatch: pytest.MonkeyPatch) -> Visit:
    monkeypatch.setattr(sandbox, "examine_backend", lambda *_: ("bubblewrap", LAYERS))
    return Visit(server, "admin")


@pytest.mark.slow
@pytest.mark.parametrize("who", ["", "red", "worker"])
def test_for_others_there_is_no_such_page(server: Server, who: str) -> None:
    visit = Visit(server, who)
    for path in PAGES:
        assert "there is nothing here" in visit.get(path, 404).words
    for path in (
        "/admin/teams",
        f"/admin/teams/{server.red}/hidden",
        "/admin/tokens",
        f"/admin/tokens/{'0' * 32}/revoke",
    ):
        visit.post(path, 404, name="x", hidden="true", scope="admin")
    assert [each["name"] for each in server.get("/teams", "admin")["items"]] == ["blue", "red"]


@pytest.mark.slow
def test_an_empty_server_says_so(admin: Visit) -> None:
    words = admin.get("/admin").words
    for said in (
        "No workers",
        "The queue is empty.",
        "No finished submissions yet.",
        "No spot checks yet.",
        "No flagged submissions.",
    ):
        assert said in words


@pytest.mark.slow
def test_the_queue_and_who_drives(server: Server, admin: Visit) -> None:
    first = sent(server, name="First")
    server.now_us = NOON + 5 * S
    sent(server, "blue", data=another_zip(1), name="Second")
    with server.store.write() as session:
        workers.record_heartbeat(session, "host.1.abc", "", NOON)
        workers.record_heartbeat(session, "host.2.dead", "", NOON - 200 * S)
        workers.record_heartbeat(session, "host.3.idle", "", NOON)
        jobs.claim(session, "host.1.abc", LEASE, NOON)
        jobs.claim(session, "host.9.stranger", LEASE, NOON)
    page = admin.get("/admin")
    rows = {each.text.split()[0]: each.text for each in page.all("tr")}
    assert "alive" in rows["host.1.abc"] and "left-turn for 5 s, attempt 1, lease ends in 55 s" in rows["host.1.abc"]
    assert "5 s ago" in rows["host.1.abc"]
    assert "silent" in rows["host.2.dead"] and "205 s ago" in rows["host.2.dead"]
    assert "alive" in rows["host.3.idle"] and "nothing" in rows["host.3.idle"]
    assert "unknown" in rows["host.9.stranger"]
    assert "1Firstreddevsingle-agentrunning0 of 2" in page.words
    assert "2Secondbluedevsingle-agentrunning0 of 2" in page.words
    assert [each.attributes["href"] for each in page.all("a") if each.text == "First"] == [f"/submissions/{first}"]
    swapped = admin.client.get("/admin").text.partition('<div id="work"')[2].partition('<h2 id="latest"')[0]
    assert "hx-trigger" in swapped and not without_ids(swapped)


@pytest.mark.slow
def test_spot_checks_the_audit_log_and_what_ended(server: Server, admin: Visit) -> None:
    id_ = sent(server, name="Mine")
    finish(server, id_)
    with server.store.write() as session:
        told = {"submission": id_, "job": 1, "same": False, "text": "ds 1, was <2>"}
        audit.add_entry(session, "server", "spot-check", told, NOON)
        head = audit.find_head(session)
    page = admin.get("/admin")
    assert "different" in page.words and "ds 1, was <2>" in page.words
    assert head in page.words and "submission-done" in page.words
    assert "Minereddevsingle-agentdone71.2" in page.words


def test_the_machine_names_missing_layers_the_disk_and_a_broken_chain(server: Server, admin: Visit) -> None:
    sent(server)
    page = admin.get("/admin/machine")
    assert "namespacesyesyesbubblewrap" in page.words
    assert "seccompmissingyesno filter" in page.words
    assert "own-kernelnononone" in page.words and "Backend bubblewrap (auto): layers" in page.words
    assert "faults of the kernel" in page.words
    assert "archives1273 bytes" in page.words.replace("1 ", "1")
    assert "unbroken" in page.words
    with server.store.write() as session:
        entry = session.get(tables.AuditEntryRow, 3)
        assert entry is not None
        entry.action = "forged"
    assert "broken Entry 3 was changed" in admin.get("/admin/machine").words


@pytest.mark.slow
def test_teams_are_made_with_a_token_shown_once(server: Server, admin: Visit) -> None:
    answer = admin.post("/admin/teams", 200, name="<green>")
    page = sound(answer)
    (issued,) = page.all("input", id="issued")
    me = server.client.get("/api/v1/me", headers={"Authorization": f"Bearer {issued.attributes['value']}"}).json()
    assert me["team"]["name"] == "<green>" and me["scope"] == "submit"
    listed = admin.get("/admin/teams")
    assert "<green>" in listed.words and issued.attributes["value"] not in listed.words
    assert "is taken" in sound(admin.post("/admin/teams", 422, name="<green>")).words
    assert "expected 1 to 64" in sound(admin.post("/admin/teams", 422, name=" ")).words


@pytest.mark.slow
def test_teams_are_hidden_and_tokens_issued_and_revoked(server: Server, admin: Visit) -> None:
    admin.post(f"/admin/teams/{server.red}/hidden", hidden="true")
    assert {each["name"]: each["hidden"] for each in server.get("/teams", "admin")["items"]} == {
        "blue": False,
        "red": True,
    }
    assert "Show red" in {each.attributes.get("aria-label") for each in admin.get("/admin/teams").all("button")}
    for scope, team in (("submit", server.red), ("admin", ""), ("worker", "")):
        page = sound(admin.post("/admin/tokens", 200, scope=scope, team=team))
        bearer = {"Authorization": f"Bearer {page.all('input', id='issued')[0].attributes['value']}"}
        assert server.client.get("/api/v1/me", headers=bearer).json()["scope"] == scope
    sound(admin.post("/admin/tokens", 422, scope="submit"))
    sound(admin.post("/admin/tokens", 422, scope="none"))
    token = server.get(f"/teams/{server.blue}/tokens", "admin")["items"][0]["id"]
    admin.post(f"/admin/tokens/{token}/revoke")
    assert server.ask("GET", "/me", "blue").status_code == 401
    assert "revoked" in admin.get("/admin/teams").words

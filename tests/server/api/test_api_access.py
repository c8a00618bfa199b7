"""Who may do what: every route, asked for by everybody there is; and the headers of what only some may see."""

import asyncio
import socket
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from io import BufferedReader
from pathlib import Path
from typing import Any
from unittest.mock import patch

import httpx
import pytest
from testing import archive_samples, store_samples
from testing.api_app import API, Server, another_zip, listening, problem
from testing.store_samples import GOOD, LEASE, PHASE, S, summary
from testing.web_page import Visit

from server import paths
from server.api import request_bodies
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.problems import ProblemError
from server.api.upload import MAX_UPLOADS
from server.cli import serve_command
from server.cli.serve_command import TimeoutProtocol
from server.enums import TokenScope
from server.store import audit, jobs, submissions, teams, tokens
from server.store.phases import set_phases
from server.store.tables import AuditEntryRow

WHO = ("", "blue", "red", "worker", "admin")
"""Nobody, another team, the submission's own team, a worker, an admin."""
PUBLIC = "200 200 200 200 200"
NO_OTHERS = "401 404 200 404 200"
ADMINS = "401 403 403 403 200"
SCENARIO = "/submissions/{submission}/scenarios/left-turn/0"
ACCESS = {
    "GET /me": "401 200 200 200 200",
    "GET /teams": ADMINS,
    "POST /teams": ADMINS.replace("200", "201"),
    "PUT /teams/{name}/hidden": ADMINS,
    "GET /teams/{name}/tokens": ADMINS,
    "POST /tokens": ADMINS.replace("200", "201"),
    "DELETE /tokens/{token}": ADMINS.replace("200", "204"),
    "POST /register": "403 403 403 403 403",  # closed, unless the settings open it
    "GET /phases": PUBLIC,
    "GET /phases/{phase}": PUBLIC,
    "GET /phases/{phase}/quota": "401 200 200 403 403",
    "POST /submissions": "401 415 415 403 403",  # the body is looked at after the token
    "GET /submissions": "401 200 200 200 200",
    "GET /submissions/{submission}": "404 404 200 404 200",
    "POST /submissions/{submission}/cancel": NO_OTHERS,
    "PUT /submissions/{submission}/shown": NO_OTHERS,
    "POST /submissions/{submission}/disqualify": ADMINS,
    "POST /submissions/{submission}/rerun": ADMINS.replace("200", "201"),
    "GET /submissions/{submission}/scenarios": "404 404 200 404 200",
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/recording": "404 404 404 404 404",  # there is none yet
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/replay": "404 404 404 404 404",
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/logs/{cav}": "401 404 404 404 404",
    "GET /submissions/{submission}/events": NO_OTHERS,
    "GET /leaderboards/{phase}": PUBLIC,
    "GET /leaderboards/{phase}/teams/{team}": PUBLIC,
    "GET /health": PUBLIC,
    "GET /metrics": "401 403 403 200 200",
    "GET /audit": ADMINS,
}
"""Of a submission that is queued, in the order of `WHO`."""
BODIES = {
    "POST /teams": {"name": "green"},
    "PUT /teams/{name}/hidden": {"hidden": False},
    "POST /tokens": {"scope": "worker"},
    "POST /register": {"name": "green"},
    "PUT /submissions/{submission}/shown": {"shown": True},
    "POST /submissions/{submission}/disqualify": {"reason": "it cheats"},
}


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def sent(server: Server, number: int = 0, **fields: str) -> str:
    return server.send(data=another_zip(number), **fields).json()["id"]


def queued(server: Server) -> str:
    """Another one of red's."""
    server.now_us += S
    with server.store.write() as session:
        found = store_samples.sent(session, server.red, server.now_us)
    paths.archive_path(server.settings, found.archive_sha256).touch()
    return found.id


def filled(server: Server, path: str, submission: str) -> str:
    with server.store.write() as session:
        blue = teams.get(session, "blue")
        tokens.issue(session, blue, TokenScope.SUBMIT, server.now_us + len(tokens.list_tokens(session, blue)))
        token = tokens.list_tokens(session, blue)[-1].id
    values = {"submission": submission, "scenario": "left-turn", "seed": "0", "cav": "cav-1", "phase": "dev"}
    for name, value in (values | {"name": "red", "team": "red", "token": token}).items():
        path = path.replace(f"{{{name}}}", value)
    return path


def test_every_route_has_its_line(server: Server) -> None:
    described = server.app.openapi()["paths"].items()
    assert {f"{method.upper()} {path.removeprefix(API)}" for path, methods in described for method in methods} == set(
        ACCESS
    )


def test_who_may_do_what(server: Server) -> None:
    with server.store.write() as session:
        set_phases(session, [replace(PHASE, per_day=500, in_parallel=500, in_total=500)], server.now_us)
    found: dict[str, str] = {}
    for operation in ACCESS:
        method, path = operation.split()
        statuses: list[str] = []
        for who in WHO:
            submission = queued(server) if "{submission}" in path else ""
            if operation.endswith("/events"):  # else they would go on
                with server.store.write() as session:
                    submissions.cancel(session, submission, server.now_us)
            answer = server.ask(method, filled(server, path, submission), who, json=BODIES.get(operation))
            statuses.append(str(answer.status_code))
        found[operation] = " ".join(statuses)
    assert found == ACCESS


def test_what_a_team_does_not_show_is_nobody_elses(server: Server) -> None:
    mine = sent(server)
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            jobs.finish(session, job.id, "w", job.attempt, GOOD, server.now_us + S)
        submissions.finish_if_complete(session, mine, lambda _: summary(80.0), server.now_us + S)
    paths = (f"/submissions/{mine}", f"/submissions/{mine}/scenarios")
    assert [server.ask("GET", path).status_code for path in paths] == [200, 200]
    assert server.get(paths[0])["archive_sha256"] is None and server.get(paths[0], "red")["archive_sha256"]
    assert server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False}).status_code == 200
    assert [server.ask("GET", path, who).status_code for path in paths for who in ("", "blue")] == [404] * 4


@pytest.mark.parametrize("part", ["%2e%2e", "..%2f..%2fetc%2fpasswd", "a%2f..%2fb", "%00", ".hidden", "x%0aINFO: y"])
def test_no_part_of_a_path_is_a_path(server: Server, part: str) -> None:
    mine = sent(server)
    one = f"/submissions/{mine}/scenarios"
    for path in (
        f"/submissions/{part}", f"{one}/{part}/0/recording", f"{one}/left-turn/0/logs/{part}", f"{one}/{part}/0/replay",
        f"/phases/{part}", f"/leaderboards/{part}", f"/teams/{part}/tokens",
    ):  # fmt: skip
        assert server.ask("GET", path, "admin").status_code in (404, 422), path


def test_what_is_ones_own_is_kept_by_nobody(server: Server) -> None:
    mine = sent(server)
    own = server.ask("GET", f"/submissions/{mine}", "red").headers
    assert (own["cache-control"], own["x-content-type-options"]) == ("no-store", "nosniff")
    everybodys = server.ask("GET", "/phases").headers
    assert (everybodys["cache-control"], everybodys["x-content-type-options"]) == ("no-cache", "nosniff")
    assert server.ask("GET", "/nothing", "red").headers["cache-control"] == "no-store"


def test_heads_without_bodies(server: Server) -> None:
    with listening(server) as address:
        asked, headed = (
            httpx.get(f"{address}{API}/phases", timeout=60),
            httpx.head(f"{address}{API}/phases", timeout=60),
        )
        assert headed.status_code == 200 and headed.content == b""
        assert headed.headers["content-length"] == asked.headers["content-length"] == str(len(asked.content))
        assert httpx.head(f"{address}{API}/submissions/{'0' * 32}/events", timeout=60).status_code == 405


def test_a_body_that_does_not_end_is_not_waited_for(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_bodies, "JSON_S", 0.2)
    monkeypatch.setattr(request_bodies, "_DRAIN_S", 0.2)
    with listening(server) as address, socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as line:
        line.settimeout(20)
        head = f"POST {API}/tokens HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\nContent-Type: application/json\r\n"
        line.sendall(f"{head}Authorization: Bearer {server.tokens['admin']}\r\n\r\n{{".encode())
        assert line.recv(4096).startswith(b"HTTP/1.1 408")


def test_a_stream_is_not_taken_for_a_body_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever streams waits for the client to leave, also where the middleware has read the body's end."""
    monkeypatch.setattr(request_bodies, "JSON_S", 0.01)
    gone, waits = asyncio.Event(), asyncio.Event()
    arrived = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> dict[str, Any]:
        if waits.is_set() and arrived:
            return arrived.pop()
        waits.set()
        await gone.wait()
        return {"type": "http.disconnect"}

    async def streamed() -> str:
        body = request_bodies._Body(receive, 100)  # pyright: ignore[reportPrivateUsage]
        leaving = asyncio.create_task(body.receive())
        await waits.wait()
        await body.drain(1)
        await asyncio.sleep(0.1)
        gone.set()
        return (await leaving)["type"]

    assert asyncio.run(streamed()) == "http.disconnect"


@contextmanager
def impatient(server: Server, good: bytes) -> Generator[tuple[socket.socket, BufferedReader]]:
    """A connection with a good request behind it; from now on the next one is waited for a second only."""
    with listening(server, http=TimeoutProtocol) as address:
        line = socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), 60)
        with line, line.makefile("rb") as answers:
            line.sendall(good)
            assert read_one(answers) == 200
            with patch.object(serve_command, "REQUEST_S", 1.0):
                yield line, answers


def test_a_request_that_does_not_end_is_not_waited_for(server: Server) -> None:
    """Neither is one after a good one."""
    good = f"GET {API}/phases HTTP/1.1\r\nHost: x\r\n\r\n".encode()
    with impatient(server, good) as (line, answers):
        line.sendall(good)
        assert read_one(answers) == 200
        with suppress(ConnectionError):  # it may be closed already
            line.sendall(good[:20])
            assert answers.read() == b""


def test_a_request_in_hand_is_not_cut(server: Server) -> None:
    """The time for the next one begins with each answer; here the next one is there by then, and takes longer."""

    @server.app.get("/slow")
    async def slow() -> str:  # pyright: ignore[reportUnusedFunction]
        await asyncio.sleep(2.5)
        return "done"

    good, long = (f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode() for path in (f"{API}/phases", "/slow"))
    with impatient(server, good) as (line, answers):
        line.sendall(good + long)
        assert [read_one(answers), read_one(answers)] == [200, 200]


def read_one(answers: BufferedReader) -> int:
    """Status of the next answer of a connection."""
    status = int(answers.readline().split()[1])
    length = 0
    while header := answers.readline().strip():
        if header.lower().startswith(b"content-length:"):
            length = int(header.split()[1])
    answers.read(length)
    return status


def at_once(count: int, deed: Callable[[int], int]) -> list[int]:
    async def all_of_them() -> list[int]:
        return await asyncio.gather(*(asyncio.to_thread(deed, number) for number in range(count)))

    return asyncio.run(all_of_them())


def test_a_quota_cannot_be_passed_together(server: Server) -> None:
    """Two at a time are allowed."""

    with listening(server) as address:

        def upload(number: int) -> int:
            files = {"archive": ("team.zip", another_zip(number))}
            form = {"phase": "dev", "track": "single-agent", "name": "method"}
            headers = {"Authorization": f"Bearer {server.tokens['red']}"}
            return httpx.post(
                f"{address}{API}/submissions", data=form, files=files, headers=headers, timeout=60
            ).status_code

        assert sorted(at_once(6, upload)) == [201, 201, 429, 429, 429, 429]


def test_an_idempotency_key_holds_for_uploads_at_once(server: Server) -> None:

    with listening(server) as address:

        def upload(_: int) -> int:
            files = {"archive": ("team.zip", another_zip(1))}
            form = {"phase": "dev", "track": "single-agent", "name": "method"}
            headers = {"Authorization": f"Bearer {server.tokens['red']}", "Idempotency-Key": "once"}
            answer = httpx.post(f"{address}{API}/submissions", data=form, files=files, headers=headers, timeout=60)
            return answer.status_code

        assert at_once(5, upload) == [201] * 5
    assert len(server.get("/submissions", "red")["items"]) == 1


@pytest.mark.parametrize("name", ["RED", "ｒｅｄ", "r" + "ed ", "0" * 32])
def test_no_team_looks_like_another(server: Server, name: str) -> None:
    problem(server.ask("POST", "/teams", "admin", json={"name": name}), 422, "name of a team")


def test_an_environment_that_is_not_built_is_refused_at_once(server: Server) -> None:

    torch = archive_samples.packed({**archive_samples.GOOD, "model_env.yaml": b"environment: python3.11-torch-cpu"})
    said = problem(server.send(data=torch), 422, "expected one of python3.11-numpy, found python3.11-torch-cpu")
    assert said["type"].endswith(":archive") and str(server.folder) not in said["detail"]
    assert server.get("/submissions", "red")["items"] == []


def test_the_audit_log_says_who_did_it(server: Server) -> None:
    mine = sent(server)
    server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False})
    server.ask("POST", f"/submissions/{mine}/cancel", "red")
    server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json={"reason": "it cheats"})
    server.ask("POST", f"/submissions/{mine}/rerun", "admin")
    with server.store.read() as session:
        admin = tokens.find_token(session, server.tokens["admin"])
        done = [(entry.action, entry.actor) for entry in store_samples.all_of(session, AuditEntryRow)][-4:]
    assert admin is not None and done == [
        ("submission-shown", f"submit:{server.red}"), ("submission-cancelled", f"submit:{server.red}"),
        ("submission-disqualified", f"admin:{admin.id}"), ("submission-rerun", f"admin:{admin.id}"),
    ]  # fmt: skip


def test_the_audit_log_says_who_made_teams_and_tokens(server: Server) -> None:
    """By the API, then by the pages."""
    page = Visit(server, "admin")
    server.ask("POST", "/teams", "admin", json={"name": "green"})
    server.ask("PUT", "/teams/green/hidden", "admin", json={"hidden": True})
    server.ask("POST", "/tokens", "admin", json={"team": "green"})
    server.ask("DELETE", f"/tokens/{server.get('/teams/green/tokens', 'admin')['items'][0]['id']}", "admin")
    page.post("/admin/teams", 200, name="grey")
    page.post(f"/admin/teams/{server.red}/hidden", hidden="true")
    page.post("/admin/tokens", 200, scope="worker")
    page.post(f"/admin/tokens/{server.get('/teams/red/tokens', 'admin')['items'][0]['id']}/revoke")
    with server.store.read() as session:
        admin = tokens.find_token(session, server.tokens["admin"])
        entries = audit.list_latest(session, 9)
        assert admin is not None and {entry.actor for entry in entries} == {f"admin:{admin.id}"}
        assert [entry.action for entry in reversed(entries)] == [
            "team-created", "team-hidden", "token-issued", "token-revoked",
            "team-created", "token-issued", "team-hidden", "token-issued", "token-revoked",
        ]  # fmt: skip


def test_a_team_uploads_a_few_at_a_time() -> None:
    uploads = ConcurrencyLimit("upload", MAX_UPLOADS)
    with ExitStack() as stack:
        for _ in range(MAX_UPLOADS):
            stack.enter_context(uploads.acquire("red"))
        with pytest.raises(ProblemError, match=f"at most {MAX_UPLOADS} of a team"), uploads.acquire("red"):
            pass
        with uploads.acquire("blue"):
            pass
    with uploads.acquire("red"):
        pass

"""Uploads that are refused: wrong fields, bad archives, too many bytes, broken forms, no token."""

from dataclasses import replace
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import pytest
from testing import archive_samples
from testing.api_app import ZIP, Server, listening, problem

from server.api import submission_service
from server.api.submission_service import starts_agents
from server.api.subprocess_runner import CallEndedError
from server.archive import ArchiveRefused, Manifest
from server.settings import ArchiveSettings, ServerSettings, WorkerSettings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fields", "status", "words"),
    [
        ({"phase": "past"}, 409, ("past", "it closed at 1970")),
        ({"phase": "nope"}, 404, ("phase", "'nope'")),
        ({"phase": ""}, 422, ("phase",)),
        ({"phase": "\0"}, 404, ("phase",)),
        ({"track": "fastest"}, 422, ("track", "single-agent")),
        ({"track": "joint"}, 422, ("track joint", "for each CAV")),
        ({"name": "x" * 81}, 422, ("name of the method",)),
        ({"name": "x" * 2000}, 422, ("name", "1024 bytes")),
        ({"colour": "red"}, 422, ("name, phase, track, archive", "'colour'")),
    ],
)
def test_wrong_fields_are_refused(server: Server, fields: dict[str, str], status: int, words: tuple[str, ...]) -> None:
    problem(server.send(**fields), status, *words)
    assert server.get("/submissions", "red")["items"] == []
    assert list(server.settings.archives.iterdir()) == []


BAD = {
    "0 bytes": (b"", "empty"),
    "no zip": (b"x" * 100, "damaged"),
    "truncated": (ZIP[:-30], "damaged"),
    "traversal": (archive_samples.with_entry("../x"), "relative"),
    "absolute": (archive_samples.with_entry("/x"), "relative"),
    "link": (archive_samples.with_entry("x", mode=0o120777), "symbolic link"),
    "twice": (archive_samples.twice("agents.py"), "once"),
    "wrong root": (archive_samples.packed({"a/agents.py": b"", "b/x": b""}), "agents.py at the top"),
    "bomb": (archive_samples.packed({**archive_samples.GOOD, "x": bytes(4_000_000)}), "200 times"),
    "encrypted": (archive_samples.patched(ZIP, "agents.py", 8, "H", 1, 6), "encryption"),
    "environment": (archive_samples.packed({**archive_samples.GOOD, "model_env.yaml": b"name: cuda"}), "'cuda'"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_bad_archives_are_refused(server: Server, name: str) -> None:
    data, word = BAD[name]
    found = problem(server.send(data=data), 422, word)
    assert found["type"].endswith(":archive")
    assert list(server.settings.archives.iterdir()) == []


def test_what_is_too_large_is_refused_while_it_comes(server: Server) -> None:
    problem(server.send(data=bytes(server.archive_bytes + 1)), 413, f"at most {server.archive_bytes}")
    problem(server.send(data=bytes(server.archive_bytes * 4)), 413, f"at most {server.archive_bytes}")
    assert list(server.settings.archives.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "content", "status", "word"),
    [
        ("application/json", b"{}", 415, "multipart/form-data"),
        ("", b"", 415, "nothing"),
        ("multipart/form-data", b"", 400, "boundary"),
        ("multipart/form-data; boundary=x", b"", 400, "middle"),
        ("multipart/form-data; boundary=x", b"--y", 400, "broken"),
        (
            "multipart/form-data; boundary=x",
            b"--x\r\nContent-Disposition: form-data; name=phase\r\n\r\nde",
            400,
            "middle",
        ),
        ("multipart/form-data; boundary=x", b"--x\r\n\r\ndev\r\n--x--", 422, "''"),
        ("multipart/form-data; boundary=x", b"--x--\r\n", 422, "archive"),
        (f"multipart/form-data; boundary={'x' * 300}", b"", 400, "broken"),
        (
            "multipart/form-data; boundary=x",
            b"--x\r\nContent-Disposition: form-data; name=phase\r\n\r\n\xff\r\n"
            b"--x\r\nContent-Disposition: form-data; name=archive\r\n\r\n\r\n--x--\r\n",
            422,
            "UTF-8",
        ),
    ],
)
def test_broken_forms_are_refused(server: Server, kind: str, content: bytes, status: int, word: str) -> None:
    answer = server.ask("POST", "/submissions", "red", content=content, headers={"Content-Type": kind})
    problem(answer, status, word)
    assert list(server.settings.archives.iterdir()) == []


@pytest.mark.slow
def test_a_refusal_reaches_a_client_that_is_still_sending(tmp_path: Path) -> None:
    """Without reading on, the connection would be cut, and a client would report that and not the answer."""
    server = Server(tmp_path, archive_bytes=20_000_000)
    with listening(server) as address:
        for headers, status in (({}, 401), ({"Authorization": f"Bearer {server.tokens['red']}"}, 415)):
            answer = httpx.post(f"{address}/api/v1/submissions", content=bytes(15_000_000), headers=headers, timeout=60)
            problem(answer, status)


def test_without_a_token_nothing_is_taken_in(server: Server) -> None:
    problem(server.send(""), 401)
    problem(server.send("admin"), 403, "submit")


def test_what_an_agent_declares_is_refused_at_upload_and_costs_no_quota(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first start in a box, by `declaration_check`, is in its own tests; here it says no."""

    def refuse(archive: Path, manifest: Manifest, settings: ServerSettings, sensor_track_only: bool) -> bool:
        assert archive.is_file() and manifest.style == "agent" and settings.limits.start_agents
        raise ArchiveRefused("sensor 'rgb': expected another")

    limits = server.settings.limits.model_copy(update={"start_agents": True, "refused_per_day": 2})
    server.app.state.services = replace(
        server.app.state.services, settings=server.settings.model_copy(update={"limits": limits})
    )
    monkeypatch.setattr(submission_service, "check_uploaded_agent", refuse)
    for _ in range(2):
        problem(server.send(), 422, "sensor 'rgb'")
    assert server.get("/phases/dev/quota", "red") == {"today": 0, "in_parallel": 0, "in_total": 0}
    assert server.get("/submissions", "red")["items"] == [] and list(server.settings.archives.iterdir()) == []
    problem(server.send(), 429, "2 archives of your team were refused today")  # each occupied a checker


def test_an_agent_whose_start_takes_too_long_is_accepted_unchecked(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang(*_: object) -> bool:
        raise CallEndedError(HTTPStatus.SERVICE_UNAVAILABLE, "busy", "it took longer")

    limits = server.settings.limits.model_copy(update={"start_agents": True})
    server.app.state.services = replace(
        server.app.state.services, settings=server.settings.model_copy(update={"limits": limits})
    )
    monkeypatch.setattr(submission_service, "check_uploaded_agent", hang)
    assert server.send().status_code == 201


@pytest.mark.parametrize(
    ("work", "starts"),
    [({}, True), ({"processes": 0}, False), ({"scheduler": "tcp://h:1"}, False), ({"phase_kinds": "hidden"}, False)],
)
def test_agents_are_started_only_where_agents_of_public_phases_run(work: dict[str, Any], starts: bool) -> None:
    assert starts_agents(ServerSettings(work=WorkerSettings(**work))) is starts
    assert not starts_agents(ServerSettings(limits=ArchiveSettings(start_agents=False)))


@pytest.mark.parametrize("path", ["/submissions/abc", "/phases/A%20B", f"/submissions/{'0' * 32}/scenarios/:/0/replay"])
def test_no_regular_expression_is_shown(server: Server, path: str) -> None:
    found = problem(server.ask("GET", path, "red"), 422, "expected ")
    assert "pattern" not in found["detail"] and "^" not in found["detail"]

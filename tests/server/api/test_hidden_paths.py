"""No answer names a path of the server."""

from pathlib import Path
from typing import Any

import pytest
from testing.api_app import API, Server

from mdrive_sumo.core.errors import InputError
from server.api.problems import HIDDEN_PATH, hide_paths
from server.store import submissions


@pytest.mark.parametrize(
    ("sentence", "shown"),
    [
        ("suite: /usr/share/secret/suite.json: found none", f"suite: {HIDDEN_PATH}: found none"),
        ("'/etc/mdrive/settings.toml'", f"'{HIDDEN_PATH}'"),
        ("there is nothing at GET /api/v1/nope/x", "there is nothing at GET /api/v1/nope/x"),
        ("/agent/agents.py: line 3", "/agent/agents.py: line 3"),
        ("expected tcp://10.0.0.1:8786/usr/x and a/usr/lib", "expected tcp://10.0.0.1:8786/usr/x and a/usr/lib"),
        ("/no-such-folder/x and /usr", "/no-such-folder/x and /usr"),
        ("means over 3 / 4 of them", "means over 3 / 4 of them"),
    ],
)
def test_paths_of_this_machine_are_hidden(sentence: str, shown: str) -> None:
    assert hide_paths(sentence) == shown


def test_errors_and_reasons_name_no_paths(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = server.send().json()["id"]
    with server.store.write() as session:
        submissions.reject(session, mine, f"{tmp_path}/suite.json: expected a suite", server.now_us)
    said = (
        server.ask("GET", f"/submissions/{mine}", "red").text
        + server.ask("GET", f"/submissions/{mine}/events", "red").text
    )
    assert str(tmp_path) not in said and said.count(HIDDEN_PATH) == 2

    def fail(*_: Any) -> list[tuple[str, int]]:
        raise InputError(f"{tmp_path}/suite/suite.json: expected a suite, found none")

    monkeypatch.setattr(server.app.state.services.suites, "jobs", fail)
    answer = server.send("blue")
    assert answer.status_code == 422 and str(tmp_path) not in answer.text and HIDDEN_PATH in answer.text
    server.mount_pages()
    assert str(tmp_path) not in server.client.get(f"{API}/submissions/x").text

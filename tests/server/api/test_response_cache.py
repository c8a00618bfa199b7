"""Answers about boards from memory: what they save, and that nobody gets what is meant for another."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from testing.api_app import HIDDEN, Server
from testing.store_samples import PHASE
from testing.web_page import Visit, driven

from server.api import response_cache
from server.api.leaderboard_cache import STALE_US, LeaderboardCache

BOARDS = ("/", f"/?phase={PHASE.id}", f"/api/v1/leaderboards/{PHASE.id}", f"/leaderboard.csv?phase={PHASE.id}")


@pytest.fixture
def server(tmp_path: Path) -> Server:
    found = Server(tmp_path)
    driven(found, "red", 41.0)
    return found


@contextmanager
def without_application() -> Iterator[None]:
    """Whatever asks for a board fails."""
    with patch.object(LeaderboardCache, "get", side_effect=AssertionError("it reached the application")):
        yield


def test_a_repeated_request_reaches_no_route(server: Server) -> None:
    client = Visit(server).client
    for path in BOARDS:
        first = client.get(path)
        with without_application():
            again = client.get(path)
        assert (again.content, again.headers) == (first.content, first.headers)
        assert first.headers["cache-control"] == "public, max-age=1" and first.headers["etag"]
        assert first.headers["x-content-type-options"] == "nosniff"


def test_an_unchanged_board_is_not_sent_again(server: Server) -> None:
    client = Visit(server).client
    etags = {path: client.get(path).headers["etag"] for path in BOARDS}
    for path, etag in etags.items():
        server.now_us += STALE_US
        for asked in (etag, f"W/{etag}", f'"other", {etag}'):
            answer = client.get(path, headers={"If-None-Match": asked})
            assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", etag)
            assert "content-type" not in answer.headers and "content-length" not in answer.headers
        assert client.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    driven(server, "red", 90.0)
    server.now_us += STALE_US
    assert all(client.get(path, headers={"If-None-Match": etag}).status_code == 200 for path, etag in etags.items())


def test_a_disqualification_is_seen_at_once(server: Server) -> None:
    mine = driven(server, "blue", 80.0)
    client = Visit(server).client
    assert all("blue" in client.get(path).text for path in BOARDS[1:])
    server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json={"reason": "it cheats"})
    assert not any("blue" in client.get(path).text for path in BOARDS[1:])


def test_nothing_personal_is_kept_or_given(server: Server) -> None:
    """Whoever asks first."""
    for path in BOARDS[:2]:
        pages = [Visit(server, who).client.get(path) for who in ("red", "", "admin", "")]
        assert [page.headers["cache-control"] for page in pages] == ["no-store", "public, max-age=1"] * 2
        assert ["Log out" in page.text for page in pages] == [True, False] * 2
    assert server.ask("GET", f"/leaderboards/{PHASE.id}").status_code == 200
    wrong = {"Authorization": "Bearer wrong"}
    known = server.ask("GET", f"/leaderboards/{PHASE.id}", "red").headers["cache-control"]
    assert (
        known == "no-store"
        and "etag" not in server.client.get(f"/api/v1/leaderboards/{PHASE.id}", headers=wrong).headers
    )
    whole = Visit(server).client.get(BOARDS[1]).text
    part = Visit(server).client.get(BOARDS[1], headers={"HX-Request": "true"}).text
    assert part in whole and len(part) < len(whole) and Visit(server).client.get(BOARDS[1]).text == whole


def test_errors_other_pages_and_methods_pass_through(server: Server) -> None:
    client = Visit(server).client
    for path in ("/?phase=nope", "/api/v1/leaderboards/nope", f"/api/v1/leaderboards/{PHASE.id}/teams/red", "/how"):
        assert "etag" not in client.get(path).headers
        assert client.get(path).headers["cache-control"] == "no-cache"
    assert client.post("/").status_code == 405 and client.head(BOARDS[1]).content == b""


def test_the_memory_is_bounded(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(response_cache, "MAX_ENTRIES", 3)
    client = Visit(server).client
    for number in range(7):
        assert client.get(f"/?phase={HIDDEN.id}&page={number + 1}").status_code == 200
    layer: Any = server.app.middleware_stack
    while not isinstance(layer, response_cache.ResponseCacheMiddleware):
        layer = getattr(layer, "app", None) or layer._app
    assert len(layer._entries) <= 3

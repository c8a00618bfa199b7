"""Pages leak nothing of hidden scenarios: the markers of tests/server/api/test_api_leaks.py, searched in every page."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.routing import iter_route_contexts
from sqlalchemy import delete
from testing.api_app import HIDDEN, Server
from testing.store_samples import PHASE
from testing.web_page import Visit

from server.api.leaderboard_cache import STALE_US
from server.api.schemas.parameters import to_datetime
from server.store import tables
from tests.server.api.test_api_leaks import MARKERS, SCENARIO, TIMES, Phase

ROUNDED = ("27.2", "31.4")
"""Markers as pages print them: DS of a single scenario, seconds that a box took."""
_NOISE = re.compile("<svg.*?</svg>|[0-9a-f]{12,}")
"""Places in drawings, random ids and hashes have every number in them some day."""


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    found = Server(tmp_path)

    def jobs(*_: object) -> list[tuple[str, int]]:
        return [(SCENARIO, 0), ("other-hidden-one", 0)]

    monkeypatch.setattr("testing.api_app.FakeSuites.jobs", jobs)
    return found


def paths(server: Server, phase: Phase) -> Iterator[str]:
    """Every page there is, with all that could be asked for."""
    Visit(server)
    found = {str(getattr(route, "path", "")) for route in iter_route_contexts(server.app.routes)
             if "GET" in (getattr(route, "methods", None) or ())}  # fmt: skip
    for template in sorted(path for path in found if path and not path.startswith(("/api/", "/static/"))):
        for each in phase.ids if "{submission}" in template else [""]:
            path = template.replace("{submission}", each).replace("{scenario}", SCENARIO).replace("{seed}", "0")
            path = path.replace("{team}", "red").replace("{cav}", "cav-1")
            query = {
                "/search": "?q=method",
                f"/submissions/{each}/compare": f"?other={phase.ids[0 if each != phase.ids[0] else 3]}",
            }
            yield path + query.get(path, "")
    for path in ("/", "/leaderboard.csv"):
        for part in ("", "&bucket=interaction", "&bucket=marker-bucket", "&category=marker-category"):
            yield f"{path}?phase={phase.phase}{part}"


def found(server: Server, phase: Phase) -> set[str]:
    """Markers that stand in a page without having been asked for."""
    server.now_us += STALE_US
    hits: set[str] = set()
    for path in paths(server, phase):
        for who in ("", "red", "blue"):
            answer = Visit(server, who).client.get(path)
            text = _NOISE.sub("", f"{answer.headers} {answer.text}")
            hits |= {marker for marker in (*MARKERS, *ROUNDED) if marker not in path and marker in text}
            assert "other-hidden-one" not in text or phase.phase == PHASE.id, path
            if "marker" in path and not path.startswith("/submissions"):
                assert answer.status_code == (404 if phase.phase == HIDDEN.id else 200), path
    return hits


@pytest.mark.slow
def test_pages_of_hidden_phases_leak_nothing(server: Server) -> None:
    assert not found(server, Phase(server, HIDDEN))


@pytest.mark.slow
def test_the_search_finds_what_is_there(server: Server) -> None:
    """What the pages of a public phase show: all but our failures, and when a scenario began and ended."""
    phase = Phase(server, PHASE)
    with server.store.write() as session:  # as no part of the server writes it
        session.execute(delete(tables.EventRow).where(tables.EventRow.kind == "scenario"))
    shown = found(server, phase)
    for marker in (SCENARIO, "marker-why", "marker-bucket", "marker-category", "marker-log", "marker-replay", *ROUNDED):
        assert marker in shown, marker
    assert not shown & {"marker-failure", str(to_datetime(TIMES["started_us"]).year)}, "admins only"

"""Events of a submission over HTTP: replayed, streamed while it runs, a few streams per team."""

import asyncio
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import httpx
import pytest
from testing.api_app import API, Server, listening, problem
from testing.api_submissions import drive_submissions
from testing.processes import wait_for

from server.api.concurrency_limit import ConcurrencyLimit
from server.api.event_watch import EventWatch
from server.store import submissions, tokens


def test_events_are_replayed_from_the_last_one_seen(server: Server) -> None:
    mine = server.send().json()["id"]
    drive_submissions(server, mine)
    answer = server.ask("GET", f"/submissions/{mine}/events", "red")
    assert answer.headers["content-type"].startswith("text/event-stream")
    blocks = answer.text.strip().split("\n\n")
    kinds = [block.split("\n")[1].removeprefix("event: ") for block in blocks]
    assert kinds == ["state", "started", "state", "scenario", "started", "scenario", "state"] or sorted(
        kinds
    ) == sorted(["state", "state", "started", "scenario", "started", "scenario", "state"])
    assert blocks[-1].endswith('data: {"state":"done"}')
    third = blocks[2].split("\n")[0].removeprefix("id: ")
    rest = server.ask("GET", f"/submissions/{mine}/events", "red", headers={"Last-Event-ID": third})
    assert rest.text.strip().split("\n\n") == blocks[3:]
    last = blocks[-1].split("\n")[0].removeprefix("id: ")
    assert server.ask("GET", f"/submissions/{mine}/events", "red", headers={"Last-Event-ID": last}).status_code == 204
    problem(server.ask("GET", f"/submissions/{mine}/events", "red", headers={"Last-Event-ID": "x"}), 422, "'x'")


def test_events_come_while_it_runs(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stream begins with what there is, waits, and ends with the submission."""
    mine = server.send().json()["id"]
    waits: list[float] = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            drive_submissions(server, mine)

    monkeypatch.setattr("server.api.routes.events.asyncio.sleep", sleep)
    monkeypatch.setattr("server.api.event_watch.REFRESH_S", 0.0)
    monkeypatch.setattr("server.api.routes.events.QUIET_POLLS", 2)
    text = server.ask("GET", f"/submissions/{mine}/events", "red").text
    assert text.startswith("id: ") and '{"state":"queued"}' in text.split("\n\n")[0]
    assert ": keep-alive\n\n" in text and text.endswith('data: {"state":"done"}\n\n')
    assert waits == [1.0] * 3


def test_a_stream_ends_when_its_token_is_revoked(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = server.send().json()["id"]
    waits: list[float] = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)
        assert len(waits) < 5
        if len(waits) == 2:
            with server.store.write() as session:
                token = tokens.find_token(session, server.tokens["red"])
                assert token is not None
                tokens.revoke(session, token.id, server.now_us)
                submissions.cancel(session, mine, server.now_us)

    monkeypatch.setattr("server.api.routes.events.asyncio.sleep", sleep)
    monkeypatch.setattr("server.api.event_watch.REFRESH_S", 0.0)
    text = server.ask("GET", f"/submissions/{mine}/events", "red").text
    assert len(waits) == 2 and '{"state":"queued"}' in text and "cancelled" not in text
    problem(server.ask("GET", f"/submissions/{mine}/events", "red"), 401)


@pytest.mark.slow
def test_a_team_follows_a_few_at_a_time(server: Server) -> None:
    mine = server.send().json()["id"]
    other = server.send("blue").json()["id"]
    limit = ConcurrencyLimit("stream of events", 2, 4)
    server.app.state.services = replace(server.app.state.services, stream_limit=limit)
    with listening(server) as address, httpx.Client(base_url=address + API, timeout=60) as http, ExitStack() as stack:

        def follow(who: str, which: str) -> httpx.Response:
            headers = {"Authorization": f"Bearer {server.tokens[who]}"}
            return stack.enter_context(http.stream("GET", f"/submissions/{which}/events", headers=headers))

        first, second = follow("red", mine), follow("red", mine)
        assert (first.status_code, second.status_code) == (200, 200)
        refused = follow("red", mine)
        refused.read()
        assert "at most 2 of a team" in problem(refused, 429)["detail"] and refused.headers["retry-after"]
        assert follow("blue", other).status_code == 200
        full = follow("blue", other)  # one place is left, for a team that has none
        full.read()
        assert "too many of all teams" in problem(full, 503)["detail"] and full.headers["retry-after"] == "30"
        first.close()
        wait_for(lambda: follow("red", mine).status_code == 200, 60.0)


def test_streams_look_at_the_database_together(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """One look for all that wait, however many; only those with news read their events."""
    mine, other = server.send().json()["id"], server.send("blue").json()["id"]
    watch, looks = EventWatch(), list[int]()
    look = watch._look
    monkeypatch.setattr(watch, "_look", lambda store: looks.append(1) or look(store))

    async def follow() -> None:
        await watch.begin(server.store)
        with server.store.read() as session:
            last = max(event.id for event in submissions.list_events(session, mine, 0, 100))
        ask = partial(watch.has_news, server.store)
        assert not any(await asyncio.gather(*(ask(mine, last, "token") for _ in range(200))))
        assert len(looks) == 1
        with server.store.write() as session:
            submissions.cancel(session, mine, server.now_us)
        monkeypatch.setattr("server.api.event_watch.REFRESH_S", 0.0)
        assert await ask(mine, last, "token") and not await ask(other, last, "token")
        with server.store.write() as session:
            token = tokens.find_token(session, server.tokens["blue"])
            assert token is not None
            tokens.revoke(session, token.id, server.now_us)
        assert await ask(other, last, token.id) and not await ask(other, last, "another")

    asyncio.run(follow())

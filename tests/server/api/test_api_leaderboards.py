"""Leaderboards over HTTP: ranks, ties, what is cached for how long, a team's history."""

import asyncio

import pytest
from testing.api_app import Server, another_zip, problem
from testing.api_submissions import drive_submissions
from testing.store_samples import NOON, S

from server.api import leaderboard_cache
from server.api.leaderboard_cache import DirectDatabaseReader
from server.api.leaderboards import BoardKey
from server.store import queries


@pytest.mark.slow
def test_boards_rank_by_ds_and_mark_published_rows(server: Server) -> None:
    for who, ds in (("red", 70.0), ("blue", 90.0)):
        drive_submissions(server, server.send(who, data=another_zip(int(ds))).json()["id"], ds=ds)
    board = server.get("/leaderboards/dev")
    assert [(row["rank"], row["team"], row["figures"]["ds"]) for row in board["rows"]] == [
        (1, "blue", 90.0),
        (2, "red", 70.0),
    ]
    assert board["published"] and all(row["published"] and row["rank"] is None for row in board["published"])
    other = server.get("/leaderboards/dev", params={"bucket": "interaction"})["rows"]
    assert [row["team"] for row in other] == ["red", "blue"]
    assert server.get("/leaderboards/dev", params={"track": "negotiation"})["rows"] == []
    category = server.get("/leaderboards/dev", params={"category": "merge"})
    assert len(category["rows"]) == 2 and category["published"] == []
    problem(server.ask("GET", "/leaderboards/dev", params={"bucket": "a", "category": "b"}), 422, "both")
    problem(server.ask("GET", "/leaderboards/nope"), 404, "'nope'")
    problem(server.ask("GET", "/leaderboards/dev", params={"track": "x"}), 422, "track")


def test_a_board_is_made_anew_only_after_something_happened(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    reads: list[object] = []
    leaderboard = queries.find_leaderboard
    monkeypatch.setattr(queries, "find_leaderboard", lambda *words: reads.append(words) or leaderboard(*words))
    assert server.get("/leaderboards/dev")["rows"] == []
    server.now_us += leaderboard_cache.STALE_US
    assert server.get("/leaderboards/dev")["rows"] == [] and len(reads) == 1
    drive_submissions(server, server.send().json()["id"])
    assert server.get("/leaderboards/dev")["rows"] == [], "looked at a moment ago"
    server.now_us += leaderboard_cache.STALE_US
    assert len(server.get("/leaderboards/dev")["rows"]) == 1 and len(reads) == 2
    problem(server.ask("GET", "/leaderboards/nope"), 404)


def test_a_board_is_handed_out_while_it_is_looked_after(server: Server) -> None:
    found = leaderboard_cache.LeaderboardCache(DirectDatabaseReader(server.store))
    which = BoardKey("dev", None, None, None)

    async def asked() -> list[bool]:
        """Whether red stands on it."""
        told = [await found.get_json(which, NOON)]
        await asyncio.to_thread(lambda: drive_submissions(server, server.send().json()["id"]))
        told += [await found.get_json(which, NOON + leaderboard_cache.FRESH_US) for _ in range(2)]
        while found._tasks:
            await asyncio.sleep(0.001)
        told.append(await found.get_json(which, NOON + leaderboard_cache.FRESH_US))
        many = await asyncio.gather(*(found.get_json(which, NOON + 99 * S) for _ in range(20)))
        return [b'"red"' in each for each in (*told, *set(many))]

    assert asyncio.run(asked()) == [False, False, False, True, True]


def test_ties_go_to_the_earlier_one(server: Server) -> None:
    for who in ("red", "blue"):
        drive_submissions(server, server.send(who).json()["id"])
        server.now_us += S
    assert [row["team"] for row in server.get("/leaderboards/dev")["rows"]] == ["red", "blue"]


@pytest.mark.slow
def test_a_teams_history(server: Server) -> None:
    ids: list[str] = []
    for number, ds in enumerate((50.0, 60.0, 55.0)):
        server.now_us += S
        ids.append(server.send(data=another_zip(number)).json()["id"])
        drive_submissions(server, ids[-1], ds=ds)
    server.ask("PUT", f"/submissions/{ids[0]}/shown", "red", json={"shown": False})
    found = server.get("/leaderboards/dev/teams/red")
    assert [(point["submission"], point["ds"]) for point in found["items"]] == [(ids[1], 60.0), (ids[2], 55.0)]

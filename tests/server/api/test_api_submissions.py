"""Submissions over HTTP: sent, followed, listed, stopped, ranked."""

import asyncio
import hashlib
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from testing import archive_samples
from testing.api_app import API, ZIP, Server, another_zip, listening, problem
from testing.processes import wait_for
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, summary

from server.api import leaderboard_cache
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.database_reader import DirectDatabaseReader
from server.api.leaderboards import BoardKey
from server.clock import DAY_US
from server.store import StoreUnavailable, jobs, queries, submissions
from server.store.phases import set_phases


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def drive(server: Server, *ids: str, ds: float = 80.0) -> None:
    """Runs all that is queued to its end."""
    with server.store.write() as session:
        while (job := jobs.claim(session, "worker", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "worker", job.attempt, GOOD, server.now_us + S)
        for each in ids:
            assert submissions.finish_if_complete(session, each, lambda _: summary(ds), server.now_us + S)


def test_an_upload_is_kept_and_queued(server: Server) -> None:
    answer = server.send()
    assert answer.status_code == 201, answer.text
    found = answer.json()
    sha256 = hashlib.sha256(ZIP).hexdigest()
    assert (found["state"], found["team"], found["archive_sha256"]) == ("queued", "red", sha256)
    assert (found["archive_bytes"], found["environment"]) == (len(ZIP), "python3.11-numpy")
    assert found["progress"] == {"queued": 2} and found["queue"] == {"position": 1, "eta_s": None}
    assert (server.settings.archives / f"{sha256}.zip").read_bytes() == ZIP
    assert [path.name for path in server.settings.archives.iterdir()] == [f"{sha256}.zip"]
    assert server.get(f"/submissions/{found['id']}", "red") == found
    assert server.get("/phases/dev/quota", "red") == {"today": 1, "in_parallel": 1, "in_total": 1}


def test_an_idempotency_key_makes_one_of_two(server: Server) -> None:
    first, second = (server.send(key="once").json() for _ in range(2))
    assert first["id"] == second["id"]
    problem(server.send(key="once", data=another_zip(1)), 422, "idempotency key")
    assert server.send(key="x" * 81).status_code == 422
    with server.store.write() as session:
        set_phases(session, [replace(PHASE, closes_us=NOON)], NOON)
    assert server.send(key="once").json()["id"] == first["id"], "an answer that was lost can be fetched after the end"


def test_the_same_archive_gets_the_finished_result(server: Server) -> None:
    first = server.send().json()["id"]
    drive(server, first)
    again = server.send().json()
    assert (again["id"], again["state"], again["summary"]["overall"]["ds"]) == (first, "done", 80.0)


def test_over_the_limits_it_says_when_to_come_back(server: Server) -> None:
    ids = [server.send(data=another_zip(number)).json()["id"] for number in range(2)]
    parallel = server.send(data=another_zip(3))
    assert problem(parallel, 429, "2 of at most 2")["kind"] == "parallel"
    assert parallel.headers["retry-after"] == "60"
    drive(server, *ids)
    assert server.send(data=another_zip(4)).status_code == 201
    day = server.send(data=another_zip(5))
    found = problem(day, 429, "3 submissions of today")
    assert found["kind"] == "day" and found["retry_at"].endswith("00:00:00 UTC")
    assert int(day.headers["retry-after"]) == DAY_US // 2 // S
    assert not list(server.settings.archives.glob("*.part"))


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
    "bomb": (archive_samples.packed({**archive_samples.GOOD, "x": bytes(40_000_000)}), "200 times"),
    "encrypted": (archive_samples.patched(ZIP, "agents.py", 8, "H", 1, 6), "encryption"),
    "environment": (archive_samples.packed({**archive_samples.GOOD, "model_env.yaml": b"name: cuda"}), "'cuda'"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_bad_archives_are_refused(server: Server, name: str) -> None:
    data, word = BAD[name]
    found = problem(server.send(data=data), 422, word)
    assert found["type"].endswith(":archive")
    assert list(server.settings.archives.iterdir()) == []


def test_a_joint_agent_has_its_own_track(server: Server) -> None:
    joint = archive_samples.packed({**archive_samples.GOOD, "agents.py": b"def get_entry_point():\n    return 'A'\n"})
    problem(server.send(data=joint), 422, "one agent for all CAVs")
    assert server.send(data=joint, track="joint").json()["track"] == "joint"


def test_what_is_too_large_is_refused_while_it_comes(server: Server) -> None:
    problem(server.send(data=bytes(server.archive_bytes + 1)), 413, f"at most {server.archive_bytes}")
    problem(server.send(data=bytes(server.archive_bytes * 4)), 413, f"at most {server.archive_bytes}")
    assert list(server.settings.archives.iterdir()) == []


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


def test_a_refusal_is_heard_by_who_is_still_sending(tmp_path: Path) -> None:
    """Without reading on, the connection would be cut, and a client would report that and not the answer."""
    server = Server(tmp_path, archive_bytes=20_000_000)
    with listening(server) as address:
        for headers, status in (({}, 401), ({"Authorization": f"Bearer {server.tokens['red']}"}, 415)):
            answer = httpx.post(f"{address}/api/v1/submissions", content=bytes(15_000_000), headers=headers, timeout=60)
            problem(answer, status)


def test_without_a_token_nothing_is_taken_in(server: Server) -> None:
    problem(server.send(""), 401)
    problem(server.send("admin"), 403, "submit")


def test_a_database_that_is_away_loses_nothing_but_time(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def away(*_: object) -> None:
        raise StoreUnavailable("locked")

    monkeypatch.setattr(submissions, "accept", away)
    answer = server.send()
    problem(answer, 503, "nothing was changed")
    monkeypatch.undo()
    assert server.send().status_code == 201


def test_nobody_sees_the_submissions_of_others(server: Server) -> None:
    mine = server.send().json()["id"]
    for who in ("blue", "worker", ""):
        problem(server.ask("GET", f"/submissions/{mine}", who), 404, mine)
    for method, path, body in (("GET", "events", None), ("POST", "cancel", None), ("PUT", "shown", {"shown": True})):
        problem(server.ask(method, f"/submissions/{mine}/{path}", "blue", json=body), 404, mine)
        problem(server.ask(method, f"/submissions/{mine}/{path}", json=body), 401)
    assert server.get("/submissions", "blue")["items"] == []
    assert server.get("/submissions", "worker")["items"] == []
    assert server.get("/submissions", "admin")["items"][0]["id"] == mine
    assert server.get(f"/submissions/{mine}", "admin")["id"] == mine


def test_what_stands_on_a_leaderboard_is_seen_by_all_but_its_archive(server: Server) -> None:
    mine = server.send().json()["id"]
    drive(server, mine)
    seen = server.get(f"/submissions/{mine}")
    assert seen["summary"]["overall"]["ds"] == 80.0
    assert {seen[name] for name in ("archive_sha256", "environment", "progress", "queue")} == {None}
    assert server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False}).json()["shown"] is False
    problem(server.ask("GET", f"/submissions/{mine}"), 404)


def test_pages_of_submissions(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    ids: list[str] = []
    for number in range(3):
        ids.append(server.send(data=another_zip(number)).json()["id"])
        drive(server, ids[-1])
    monkeypatch.setattr("server.api.routes.submissions.PAGE", 2)
    expected = sorted(ids, reverse=True)  # all of one moment: by id
    first = server.get("/submissions", "red")
    second = server.get("/submissions", "red", params={"before": first["next"]})
    assert [each["id"] for page in (first, second) for each in page["items"]] == expected
    assert second["next"] is None
    assert server.get("/submissions", "red", params={"phase": "test"})["items"] == []
    assert len(server.get("/submissions", "admin", params={"team": "red"})["items"]) == 2
    assert server.get("/submissions", "admin", params={"team": "blue"})["items"] == []
    problem(server.ask("GET", "/submissions", "blue", params={"before": ids[0]}), 404)
    problem(server.ask("GET", "/submissions", "admin", params={"team": "nobody"}), 404)


def test_a_submission_is_cancelled_once(server: Server) -> None:
    mine = server.send().json()["id"]
    found = server.ask("POST", f"/submissions/{mine}/cancel", "red").json()
    assert (found["state"], found["counts"], found["queue"]) == ("cancelled", False, None)
    problem(server.ask("POST", f"/submissions/{mine}/cancel", "red"), 409, "cancelled")


def test_an_admin_disqualifies_with_a_reason(server: Server) -> None:
    mine = server.send().json()["id"]
    drive(server, mine)
    assert len(server.get("/leaderboards/dev")["rows"]) == 1
    body = {"reason": "it knew the scenarios by heart"}
    found = server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json=body).json()
    assert (found["state"], found["why"]) == ("disqualified", body["reason"])
    assert server.get("/leaderboards/dev")["rows"] == [], "at once, although boards are kept for a second"
    problem(server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json={"reason": " "}), 422, "reason")


def test_an_admin_has_it_driven_again(server: Server) -> None:
    mine = server.send().json()["id"]
    drive(server, mine)
    again = server.ask("POST", f"/submissions/{mine}/rerun", "admin").json()
    assert again["id"] != mine and (again["state"], again["counts"], again["shown"]) == ("queued", False, False)


def test_what_is_cleared_up_cannot_be_driven_again(server: Server) -> None:
    mine = server.send().json()
    drive(server, mine["id"])
    (server.settings.archives / f"{mine['archive_sha256']}.zip").unlink()
    problem(server.ask("POST", f"/submissions/{mine['id']}/rerun", "admin"), 409, "its archive has been deleted")
    assert len(server.get("/submissions", "red")["items"]) == 1


def test_the_same_archive_is_driven_anew_in_a_newer_environment(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    def evaluator(_: object, __: object, environment: str) -> dict[str, str]:
        return {"version": "1", "environment": holds if environment == "python3.11-numpy" else ""}

    monkeypatch.setattr("testing.api_app.FakeSuites.evaluator", evaluator)
    holds = "numpy 1"
    first = server.send().json()
    drive(server, first["id"], ds=50.0)
    assert server.send().json()["id"] == first["id"]
    holds = "numpy 2"
    second = server.send().json()
    assert second["id"] != first["id"] and second["state"] == "queued"
    drive(server, second["id"], ds=60.0)
    assert [(row["rank"], row["submission"]) for row in server.get("/leaderboards/dev")["rows"]] == [(1, second["id"])]


def test_events_are_replayed_from_the_last_one_seen(server: Server) -> None:
    mine = server.send().json()["id"]
    drive(server, mine)
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
            drive(server, mine)

    monkeypatch.setattr("server.api.routes.events.asyncio.sleep", sleep)
    monkeypatch.setattr("server.api.routes.events.QUIET_POLLS", 2)
    text = server.ask("GET", f"/submissions/{mine}/events", "red").text
    assert text.startswith("id: ") and '{"state":"queued"}' in text.split("\n\n")[0]
    assert ": keep-alive\n\n" in text and text.endswith('data: {"state":"done"}\n\n')
    assert waits == [1.0] * 3


def test_a_team_follows_a_few_at_a_time(server: Server) -> None:
    mine = server.send().json()["id"]
    other = server.send("blue").json()["id"]
    server.app.state.services = replace(server.app.state.services, stream_limit=ConcurrencyLimit("stream of events", 2))
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
        first.close()
        wait_for(lambda: follow("red", mine).status_code == 200, 60.0)


def test_boards_rank_by_ds_and_mark_published_rows(server: Server) -> None:
    for who, ds in (("red", 70.0), ("blue", 90.0)):
        drive(server, server.send(who, data=another_zip(int(ds))).json()["id"], ds=ds)
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
    drive(server, server.send().json()["id"])
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
        await asyncio.to_thread(lambda: drive(server, server.send().json()["id"]))
        told += [await found.get_json(which, NOON + leaderboard_cache.FRESH_US) for _ in range(2)]
        while found._tasks:
            await asyncio.sleep(0.001)
        told.append(await found.get_json(which, NOON + leaderboard_cache.FRESH_US))
        many = await asyncio.gather(*(found.get_json(which, NOON + 99 * S) for _ in range(20)))
        return [b'"red"' in each for each in (*told, *set(many))]

    assert asyncio.run(asked()) == [False, False, False, True, True]


def test_ties_go_to_the_earlier_one(server: Server) -> None:
    for who in ("red", "blue"):
        drive(server, server.send(who).json()["id"])
        server.now_us += S
    assert [row["team"] for row in server.get("/leaderboards/dev")["rows"]] == ["red", "blue"]


def test_a_teams_history(server: Server) -> None:
    ids: list[str] = []
    for number, ds in enumerate((50.0, 60.0, 55.0)):
        server.now_us += S
        ids.append(server.send(data=another_zip(number)).json()["id"])
        drive(server, ids[-1], ds=ds)
    server.ask("PUT", f"/submissions/{ids[0]}/shown", "red", json={"shown": False})
    found = server.get("/leaderboards/dev/teams/red")
    assert [(point["submission"], point["ds"]) for point in found["items"]] == [(ids[1], 60.0), (ids[2], 55.0)]

"""Submissions over HTTP: sent, listed, shown, cancelled, disqualified, driven again."""

import hashlib
from dataclasses import replace

import pytest
from testing import archive_samples
from testing.api_app import ZIP, Server, another_zip, problem
from testing.api_submissions import drive_submissions
from testing.store_samples import NOON, PHASE, S

from server.clock import DAY_US
from server.store import StoreUnavailable, submissions
from server.store.phases import set_phases


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
    drive_submissions(server, first)
    again = server.send().json()
    assert (again["id"], again["state"], again["summary"]["overall"]["ds"]) == (first, "done", 80.0)


@pytest.mark.slow
def test_over_the_limits_it_says_when_to_come_back(server: Server) -> None:
    ids = [server.send(data=another_zip(number)).json()["id"] for number in range(2)]
    parallel = server.send(data=another_zip(3))
    assert problem(parallel, 429, "2 of at most 2")["kind"] == "parallel"
    assert parallel.headers["retry-after"] == "60"
    drive_submissions(server, *ids)
    assert server.send(data=another_zip(4)).status_code == 201
    day = server.send(data=another_zip(5))
    found = problem(day, 429, "3 submissions of today")
    assert found["kind"] == "day" and found["retry_at"].endswith("00:00:00 UTC")
    assert int(day.headers["retry-after"]) == DAY_US // 2 // S
    assert not list(server.settings.archives.glob("*.part"))


def test_a_joint_agent_has_its_own_track(server: Server) -> None:
    joint = archive_samples.packed({**archive_samples.GOOD, "agents.py": b"def get_entry_point():\n    return 'A'\n"})
    problem(server.send(data=joint), 422, "one agent for all CAVs")
    assert server.send(data=joint, track="joint").json()["track"] == "joint"


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
    drive_submissions(server, mine)
    seen = server.get(f"/submissions/{mine}")
    assert seen["summary"]["overall"]["ds"] == 80.0
    assert {seen[name] for name in ("archive_sha256", "environment", "progress", "queue")} == {None}
    assert server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False}).json()["shown"] is False
    problem(server.ask("GET", f"/submissions/{mine}"), 404)


@pytest.mark.slow
def test_pages_of_submissions(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    ids: list[str] = []
    for number in range(3):
        ids.append(server.send(data=another_zip(number)).json()["id"])
        drive_submissions(server, ids[-1])
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
    drive_submissions(server, mine)
    assert len(server.get("/leaderboards/dev")["rows"]) == 1
    body = {"reason": "it knew the scenarios by heart"}
    found = server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json=body).json()
    assert (found["state"], found["why"]) == ("disqualified", body["reason"])
    assert server.get("/leaderboards/dev")["rows"] == [], "at once, although boards are kept for a second"
    problem(server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json={"reason": " "}), 422, "reason")


def test_an_admin_has_it_driven_again(server: Server) -> None:
    mine = server.send().json()["id"]
    drive_submissions(server, mine)
    again = server.ask("POST", f"/submissions/{mine}/rerun", "admin").json()
    assert again["id"] != mine and (again["state"], again["counts"], again["shown"]) == ("queued", False, False)


def test_what_is_cleared_up_cannot_be_driven_again(server: Server) -> None:
    mine = server.send().json()
    drive_submissions(server, mine["id"])
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
    drive_submissions(server, first["id"], ds=50.0)
    assert server.send().json()["id"] == first["id"]
    holds = "numpy 2"
    second = server.send().json()
    assert second["id"] != first["id"] and second["state"] == "queued"
    drive_submissions(server, second["id"], ds=60.0)
    assert [(row["rank"], row["submission"]) for row in server.get("/leaderboards/dev")["rows"]] == [(1, second["id"])]

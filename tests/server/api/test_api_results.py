"""Results of single scenarios, their recordings, replays and logs; and the process that makes what takes long."""

import fcntl
import os
import signal
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path

import httpx
import pytest
from testing.api_app import API, Server, listening, problem
from testing.processes import wait_for, written
from testing.runner_jobs import end_by_signal, noted_sleep, refuse
from testing.store_samples import LEASE, S, summary

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.suite import load_suite
from server import paths
from server.api import child_calls
from server.api.app import MAX_REPLAYS
from server.api.problems import ProblemError
from server.api.subprocess_runner import CallEndedError, SubprocessRunner
from server.enums import ScenarioVerdict
from server.store import jobs, submissions
from server.store.jobs import JobOutcome

pytestmark = pytest.mark.slow

EGO = {
    "id": "cav-1", "outcome": "agent-failed", "reason": "timeout: 10 s", "ds": 20.0, "rc": 20.0, "ip": 1.0,
    "infractions": [{"kind": "collision-vehicle", "tick": 7, "x": 1.5, "y": 2.5, "factor": 0.6, "other": "bg-3"}],
}  # fmt: skip
RESULT = {"ds": 20.0, "sr": 0.0, "rc": 20.0, "ip": 1.0, "bucket": "interdrive", "category": "merge", "egos": [EGO]}
OUTCOME = JobOutcome(ScenarioVerdict.AGENT_FAILED, RESULT, FailureReason.TIMEOUT, {"cpu_s": 1.5})


def finished(server: Server, phase: str = "dev", with_files: bool = True) -> str:
    """A submission of red, driven; with the files that the evaluation writes."""
    mine = server.send(phase=phase).json()["id"]
    with server.store.write() as session:
        while (job := jobs.claim(session, "worker", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "worker", job.attempt, OUTCOME, server.now_us + S)
        assert submissions.finish_if_complete(session, mine, summary(20.0), server.now_us + S)
    if with_files:
        place = (server.settings, mine, "merge", 0)
        paths.recordings_folder(server.settings, mine, 0).mkdir(parents=True)
        paths.recording_path(*place).write_bytes(b"npz")
        paths.replay_path(*place).write_text("<html>replay</html>")
        paths.log_path(*place, "cav-1").write_bytes(b"hello \xff")
    return mine


def test_every_scenario_with_its_verdict(server: Server) -> None:
    mine = finished(server)
    first, second = server.get(f"/submissions/{mine}/scenarios", "red")["items"]
    assert (first["scenario"], second["scenario"]) == ("left-turn", "merge")
    assert (second["verdict"], second["reason"], second["ds"], second["category"]) == (
        "agent-failed", "timeout", 20.0, "merge",
    )  # fmt: skip
    assert second["egos"][0]["infractions"][0]["x"] == 1.5 and second["usage"] == {"cpu_s": 1.5}
    assert (second["recording"], second["logs"], second["failure"]) == (True, ["cav-1"], None)
    assert (first["recording"], first["logs"]) == (False, [])


def test_others_see_results_on_leaderboards_but_no_logs(server: Server) -> None:
    mine = finished(server)
    assert server.get(f"/submissions/{mine}/scenarios")["items"][1]["logs"] == []
    assert server.ask("GET", f"/submissions/{mine}/scenarios/merge/0/recording").content == b"npz"
    problem(server.ask("GET", f"/submissions/{mine}/scenarios/merge/0/logs/cav-1"), 401)
    problem(server.ask("GET", f"/submissions/{mine}/scenarios/merge/0/logs/cav-1", "blue"), 404)
    server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False})
    for what in ("", "/merge/0/recording", "/merge/0/replay"):
        problem(server.ask("GET", f"/submissions/{mine}/scenarios{what}", "blue"), 404, mine)


def test_files_of_a_scenario(server: Server) -> None:
    mine = finished(server)
    one = f"/submissions/{mine}/scenarios/merge/0"
    answer = server.ask("GET", f"{one}/recording", "red")
    assert 'filename="merge-0.npz"' in answer.headers["content-disposition"]
    answer = server.ask("GET", f"{one}/replay", "red")
    assert answer.text == "<html>replay</html>" and answer.headers["content-type"].startswith("text/html")
    assert answer.headers["content-security-policy"].startswith("sandbox")
    answer = server.ask("GET", f"{one}/logs/cav-1", "red")
    assert answer.content == b"hello \xff" and answer.headers["content-type"] == "text/plain; charset=utf-8"
    assert answer.headers["x-content-type-options"] == "nosniff"
    for path, word in (
        ("left-turn/0/recording", "recording"), ("left-turn/0/replay", "recording"), ("merge/0/logs/cav-9", "log"),
        ("nope/0/recording", "'nope'"), ("merge/1/replay", "seed 1"),
    ):  # fmt: skip
        problem(server.ask("GET", f"/submissions/{mine}/scenarios/{path}", "red"), 404, word)
    for path in ("%2e%2e/0/recording", "merge/-1/recording", "merge/9999999999999999999999/recording"):
        assert server.ask("GET", f"/submissions/{mine}/scenarios/{path}", "red").status_code in (404, 422)


def test_a_replay_is_made_once(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = finished(server)
    page = paths.replay_path(server.settings, mine, "merge", 0)
    page.unlink()
    orders: list[child_calls.ReplayRequest] = []

    def make(order: child_calls.ReplayRequest) -> None:
        orders.append(order)
        order.page.write_text("made")

    monkeypatch.setattr(child_calls, "write_replay_page", make)
    for _ in range(2):
        assert server.ask("GET", f"/submissions/{mine}/scenarios/merge/0/replay").text == "made"
    assert [(order.suite, order.scenario, order.result["ds"]) for order in orders] == [("interdrive", "merge", 20.0)]


def locked(order: child_calls.ReplayRequest) -> None:
    """Paint a replay in another process; it takes as long as the recording is locked."""
    with order.recording.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
    part = order.page.with_suffix(".part")
    part.write_text("made")
    part.replace(order.page)  # it may be being read


@pytest.mark.full
def test_requests_that_wait_for_replays_do_not_stop_the_server(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = finished(server)
    paths.replay_path(server.settings, mine, "merge", 0).unlink()
    monkeypatch.setattr(child_calls, "write_replay_page", locked)
    painter = SubprocessRunner(MAX_REPLAYS)
    server.app.state.services = replace(server.app.state.services, replay_runner=painter)
    one = f"{API}/submissions/{mine}/scenarios/merge/0/replay"
    number = 45  # more than there are threads for all requests
    with (
        paths.recording_path(server.settings, mine, "merge", 0).open("rb") as held,
        listening(server) as address,
        closing(painter),
        ThreadPoolExecutor(number) as pool,
    ):
        fcntl.flock(held, fcntl.LOCK_EX)
        asked = [pool.submit(httpx.get, address + one, timeout=120) for _ in range(number)]
        answers = [done.result() for done in islice(as_completed(asked), number - MAX_REPLAYS)]
        assert httpx.get(f"{address}{API}/health", timeout=60).status_code == 200
        assert not all(each.done() for each in asked)
        fcntl.flock(held, fcntl.LOCK_UN)
        assert Counter(each.result().status_code for each in asked) == {200: MAX_REPLAYS, 503: number - MAX_REPLAYS}
    assert all("too many" in problem(each, 503)["detail"] and each.headers["retry-after"] for each in answers)


def test_a_page_that_was_made_meanwhile_is_not_made_again(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("made")
    child_calls.write_replay_page(child_calls.ReplayRequest("no-such-suite", "merge", {}, tmp_path / "no.npz", page))
    assert page.read_text() == "made"


def test_a_replay_of_a_real_episode(tmp_path: Path) -> None:
    scenario = load_suite("interdrive@0").scenarios[0].id
    recording, page = tmp_path / "episode.npz", tmp_path / "page.html"
    job = EpisodeJob(find_suite_folder("interdrive@0"), scenario, AgentSpec("idm"), recording=recording)
    aside = SubprocessRunner(1)
    try:
        result = aside.call(120.0, run_job, job)
        aside.call(
            60.0,
            child_calls.write_replay_page,
            child_calls.ReplayRequest("interdrive", scenario, result.model_dump(), recording, page),
        )
    finally:
        aside.close()
    text = page.read_text("utf-8")
    assert f"<title>{scenario}" in text and len(text) > 50_000 and not list(tmp_path.glob("*.part"))


def test_of_hidden_phases_only_admins_see_scenarios(server: Server) -> None:
    mine = finished(server, "test")
    for path in ("", "/merge/0/recording", "/merge/0/replay", "/merge/0/logs/cav-1"):
        problem(server.ask("GET", f"/submissions/{mine}/scenarios{path}", "red"), 403, "hidden")
    assert len(server.get(f"/submissions/{mine}/scenarios", "admin")["items"]) == 2


def test_failures_of_ours_are_told_to_admins(server: Server) -> None:
    mine = server.send().json()["id"]
    with server.store.write() as session:
        job = jobs.claim(session, "worker", LEASE, server.now_us)
        assert job is not None and jobs.record_failure(session, job.id, "worker", 1, "libsumo fell", server.now_us)
    assert server.get(f"/submissions/{mine}/scenarios", "admin")["items"][0]["failure"] == "libsumo fell"
    assert "libsumo" not in str(server.get(f"/submissions/{mine}/scenarios", "red"))


def test_a_process_of_its_own_answers_and_raises() -> None:
    aside = SubprocessRunner(1)
    try:
        assert aside.call(60.0, os.getpid) != os.getpid()
        assert aside.call(60.0, os.getpid) == aside.call(60.0, os.getpid), "it stays"
        with pytest.raises(InputError, match="expected better"):
            aside.call(60.0, refuse)
        with pytest.raises(FileNotFoundError):
            aside.call(60.0, os.stat, "/nowhere")
        before = aside.call(60.0, os.getpid)
        with pytest.raises(ProblemError, match=r"longer than 0\.1 s"):
            aside.call(0.1, time.sleep, 60)
        with pytest.raises(ProblemError, match="process ended"):
            aside.call(60.0, os._exit, 1)
        assert aside.call(60.0, os.getpid) != before
        with pytest.raises(ProcessLookupError):
            os.kill(before, 0)
    finally:
        aside.close()


def test_a_call_whose_process_is_killed_from_outside_is_made_once_more(tmp_path: Path) -> None:
    """Else a kill by an operator or for want of memory is a refused archive of the team."""
    aside = SubprocessRunner(1)
    try:
        assert aside.call(60.0, end_by_signal, tmp_path / "killed", signal.SIGKILL, 1) == 2
        with pytest.raises(CallEndedError, match="process ended"):
            aside.call(60.0, end_by_signal, tmp_path / "killed twice", signal.SIGTERM, 2)
        with pytest.raises(CallEndedError, match="process ended"):
            aside.call(60.0, end_by_signal, tmp_path / "crashed", signal.SIGSEGV, 1)
        assert [(tmp_path / name).read_text() for name in ("killed twice", "crashed")] == ["xx", "x"]
    finally:
        aside.close()


def test_closing_a_subprocess_ends_all_waiting_calls_at_once(tmp_path: Path) -> None:
    aside, begun = SubprocessRunner(5), tmp_path / "begun"
    with ThreadPoolExecutor(5) as pool:
        asked = [pool.submit(aside.call, 600.0, noted_sleep, begun) for _ in range(5)]
        wait_for(lambda: written(begun), 60.0)
        aside.close()
        for each in asked:
            with pytest.raises(ProblemError):
                each.result(timeout=60)
    assert begun.read_text() == "x", "no call after the first had a turn"
    with pytest.raises(ProblemError, match="the server is shutting down"):
        aside.call(60.0, os.getpid)

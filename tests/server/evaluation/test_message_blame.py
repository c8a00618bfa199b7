"""Cross-play: whose messages made a partner's agent fail is found by driving the episode again without them."""

from collections.abc import Callable
from pathlib import Path

import pytest
from testing.short_suite import make_short_suite

from mdrive_sumo.core.state import End
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.scoring import EgoResult, ScenarioResult
from server.evaluation.cross_play import REPEATS_FOLDER, compute_score, is_failure_by_messages

AGENTS = """
from mdrive_sumo.contract import STANDSTILL, Message, Reply


class Writer:
    label = "negotiation"

    def __init__(self, config):
        self.payload = bytes(config.get("text", "hello"), "utf-8")

    def sensors(self):
        return ()

    def start(self, briefing):
        pass

    def act(self, seen):
        return Reply(control=STANDSTILL, messages=(Message("text", self.payload),))


class Reader(Writer):
    \"\"\"Has no place for a message that is not a number.\"\"\"

    def act(self, seen):
        for message in seen.messages:
            int(bytes(message.payload))
        return Reply(control=STANDSTILL)


class Breaker(Writer):
    def act(self, seen):
        raise RuntimeError("always")
"""


def ego(name: str, *, failed: bool = False, is_other: bool = False) -> EgoResult:
    outcome, reason = (End.AGENT_FAILED, "crashed: exit") if failed else (End.ARRIVED, "")
    scores = {"ds": 90.0, "rc": 90.0, "ip": 1.0}
    return EgoResult(id=name, outcome=outcome, reason=reason, **scores, infractions=(), is_other=is_other)


def result(*, others_fail: bool, exchanged: int = 5) -> ScenarioResult:
    facts = {"id": "s", "bucket": "b", "category": "c", "seed": 0, "status": "ok", "reason": "", "digest": ""}
    scores = {"ds": 90.0, "sr": 0.0, "rc": 90.0, "ip": 1.0, "min_ttc": None}
    egos = ego("0"), ego("1", failed=others_fail, is_other=True), ego("2", is_other=True)
    seen = {"egos": egos, "exchanged": {"text": exchanged} if exchanged else {}, "ticks": 9}
    return ScenarioResult.model_validate(facts | scores | seen)


def make_job(folder: Path) -> EpisodeJob:
    return EpisodeJob(folder, "s", AgentSpec("idm"), seed=0, options=EpisodeOptions(), recording=folder / "s.npz")


@pytest.fixture
def repeats(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[EpisodeJob]]:
    """Replace driving: the others fail with or without messages as said; returns the jobs that are driven."""

    def begin(*, without: bool, with_messages: bool) -> list[EpisodeJob]:
        jobs: list[EpisodeJob] = []

        def drive(job: EpisodeJob) -> ScenarioResult:
            jobs.append(job)
            return result(others_fail=without if job.options.comm.mute else with_messages)

        monkeypatch.setattr("server.evaluation.cross_play.run_job", drive)
        return jobs

    return begin


@pytest.mark.parametrize(
    ("without", "with_messages", "is_blamed"),
    [(False, True, True), (True, True, False), (False, False, False), (True, False, False)],
)
def test_who_fails_only_with_the_messages_fails_by_them(
    repeats: Callable[..., list[EpisodeJob]], tmp_path: Path, without: bool, with_messages: bool, is_blamed: bool
) -> None:
    """Neither what fails in any company nor what does not fail again is blamed on the agent under test."""
    jobs = repeats(without=without, with_messages=with_messages)
    assert is_failure_by_messages(make_job(tmp_path), result(others_fail=True), tmp_path) is is_blamed
    assert jobs[0].options.comm.mute == ("0/*",), "those of the CAV under test"
    assert {(job.recording, job.logs) for job in jobs} == {(None, tmp_path / REPEATS_FOLDER)}


@pytest.mark.parametrize("first", [result(others_fail=False), result(others_fail=True, exchanged=0)])
def test_without_a_failure_or_without_messages_nothing_is_driven_again(
    repeats: Callable[..., list[EpisodeJob]], tmp_path: Path, first: ScenarioResult
) -> None:
    jobs = repeats(without=False, with_messages=True)
    assert not is_failure_by_messages(make_job(tmp_path), first, tmp_path) and jobs == []


def test_a_rejection_in_a_repeat_blames_nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def drive(_: EpisodeJob) -> ScenarioResult:
        raise RejectedError("sensor")

    monkeypatch.setattr("server.evaluation.cross_play.run_job", drive)
    assert not is_failure_by_messages(make_job(tmp_path), result(others_fail=True), tmp_path)


def test_who_stops_its_partners_has_the_score_of_a_failure_of_its_own() -> None:
    stopped = compute_score(result(others_fail=True), by_messages=True)
    assert (stopped.ds, stopped.sr, stopped.counts) == (pytest.approx(54.0), 0.0, True)
    assert not compute_score(result(others_fail=True)).counts


@pytest.mark.slow
@pytest.mark.parametrize(("partner", "is_blamed"), [("Reader", True), ("Breaker", False)])
def test_agents_that_drive(tmp_path: Path, partner: str, is_blamed: bool) -> None:
    (tmp_path / "agents.py").write_text(AGENTS)
    suite = make_short_suite(tmp_path / "suite", "i01_ins_c_main_street_right", metres=5)
    writer, other = (AgentSpec(f"{tmp_path}/agents.py:{name}") for name in ("Writer", partner))
    job = EpisodeJob(suite, "i01_ins_c_main_street_right", writer, others=OtherAgents(other), seed=0)
    assert is_failure_by_messages(job, run_job(job), tmp_path) is is_blamed

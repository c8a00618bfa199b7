"""Dry runs give the server's verdicts, in the server's boxes; environments are built by pip and found again."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from testing.archive_samples import GOOD, packed, written
from testing.local_executor import LocalExecutor
from testing.participant_fakes import Run, command_line
from testing.sandbox_runs import needs_bubblewrap
from testing.suite_fakes import make_suite

from mdrive_sumo.agent_process.remote_driver import AgentLimits
from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.agent_process.sandbox import BoxLimits, SandboxLayer
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import EgoResult, ScenarioResult, make_void_result
from mdrive_sumo.v2x.comm_settings import CommSettings
from server import environments, settings
from server.archive import ArchiveLimits, check_archive
from server.enums import ChallengeTrack, ScenarioVerdict
from server.environments import Environment
from server.participant import dry_run
from server.participant.dry_run import format_result, with_server_limits
from server.participant.packaging import unpack_agent
from server.settings import ServerSettings
from server.submitted_agent import SubmittedAgent, find_verdict
from server.tracks import COMM_BY_TRACK

boxed = needs_bubblewrap
HERE = Environment("x", Path(sys.executable), Path("/site"), ())
HOSTILE = """
import os, time
from mdrive_sumo.contract import STANDSTILL, Reply, SensorSpec

class Agent:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return ({sensors})
    def start(self, briefing): pass
    def act(self, seen):
        if seen.tick == 3:
            {deed}
        return Reply(control=STANDSTILL)
"""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    monkeypatch.chdir(tmp_path)
    return command_line(monkeypatch)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenarios are driven in the process of the test: a worker process takes two seconds of imports."""
    monkeypatch.setattr(dry_run, "ProcessPool", LocalExecutor)


def result(**reasons: str) -> ScenarioResult:
    """Of CAVs by id; those with a reason failed."""
    egos = tuple(
        EgoResult(
            id=name, outcome=End.AGENT_FAILED if why else End.ARRIVED, reason=why, ds=1, rc=1, ip=1, infractions=()
        )
        for name, why in reasons.items()
    )
    scenario = load_suite("interdrive@0").scenarios[0]
    return make_void_result(scenario, 0, "x").model_copy(update={"status": "ok", "egos": egos})


def test_verdicts() -> None:
    assert find_verdict(result(a="", b="")) == (ScenarioVerdict.OK, None)
    assert find_verdict(result(a="", b="timeout: no answer")) == (ScenarioVerdict.AGENT_FAILED, FailureReason.TIMEOUT)
    assert find_verdict(result(a="invalid: NaN", b="crashed: x")) == (
        ScenarioVerdict.AGENT_FAILED,
        FailureReason.INVALID,
    )
    assert find_verdict(result(a="").model_copy(update={"status": "void"})) == (ScenarioVerdict.FAILED_OURS, None)
    assert format_result(result(a="crashed: ValueError: x")).startswith("agent-failed (crashed): i01_")


def test_limits_and_backend_are_those_of_a_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "choose_backend", lambda wanted: {"auto": "gvisor"}[wanted])
    with unpack_agent(written(tmp_path, packed(GOOD))) as found:
        entrant = with_server_limits(found, HERE)
    sandbox = ServerSettings().sandbox
    assert entrant.box == sandbox.box_limits()
    assert (entrant.limits.tick_s, entrant.limits.reply_bytes) == (sandbox.tick_s, sandbox.reply_bytes)
    spec = entrant.agent_spec()
    assert spec.box is not None
    assert (spec.agent, spec.limits, spec.box.folder) == ("/agent/agents.py:Agent", entrant.limits, found.folder)
    assert (spec.box.backend, spec.box.python, spec.box.site) == ("gvisor", sys.executable, Path("/site"))


def memory_bytes(agent: SubmittedAgent) -> int:
    box = agent.agent_box()
    assert box is not None
    return box.limits.memory_bytes


def test_an_environment_brings_the_memory_it_needs(tmp_path: Path) -> None:
    manifest = check_archive(written(tmp_path, packed(GOOD)), ArchiveLimits())
    small = SubmittedAgent(manifest, tmp_path, HERE, BoxLimits(memory_bytes=1), AgentLimits())
    torch = replace(small, manifest=replace(manifest, environment="python3.11-torch-cpu"))
    needed = environments.RECIPES["python3.11-torch-cpu"].memory_bytes
    assert memory_bytes(small) == environments.RECIPES["python3.11-numpy"].memory_bytes
    assert memory_bytes(torch) == needed
    assert memory_bytes(replace(torch, box=BoxLimits(memory_bytes=2 * needed))) == 2 * needed


@pytest.mark.parametrize("active", [False, True])
def test_what_boxes_lack_here_is_said(run: Run, monkeypatch: pytest.MonkeyPatch, active: bool) -> None:
    names = (*ServerSettings().sandbox.required, "own-kernel")
    absent = ("uid", "cgroup", "own-kernel")
    here = tuple(SandboxLayer(name, active or name not in absent, f"why {name}") for name in names)
    monkeypatch.setattr(dry_run, "examine_layers", lambda _: here)
    monkeypatch.setattr(dry_run, "ask_agent", lambda _: AgentDeclaration("single", ()))
    monkeypatch.setattr(dry_run, "run_jobs", lambda *_: [])
    run("init-agent", "mine")
    said = run("submit", "mine", "--dry-run")
    assert said.exit_code == 0, said.output
    note = (
        "note: sandboxes on this machine lack layers that a server has by default: uid (why uid); cgroup (why cgroup)\n"
    )
    assert said.output.count("sandboxes on this machine lack") == said.output.count(note) == (0 if active else 1)


@boxed
@pytest.mark.slow
def test_a_sample_drives_in_its_box(run: Run, tmp_path: Path) -> None:
    run("init-agent", "mine", "--style", "joint")
    found = run(
        "submit", "mine", "--dry-run", "--suite", "interdrive@0", "--scenario", "i07*", "--workers", 1, "--out", "out"
    )
    assert found.exit_code == 0, found.output
    assert "label        joint: track joint" in found.output
    assert "track        joint" in found.output
    assert "ok: i07_ins_ss_town  DS" in found.output
    assert "1 scenario: DS" in found.output
    assert (tmp_path / "out" / "episodes" / "i07_ins_ss_town.npz").is_file()


@boxed
@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("deed", "verdict"),
    [
        ("os._exit(3)", "agent-failed (crashed): i13_ins_sl_minor_road"),
        pytest.param("raise SystemExit", "agent-failed (crashed): i13_ins_sl_minor_road", marks=pytest.mark.full),
        ("return Reply()", "agent-failed (invalid): i13_ins_sl_minor_road"),
        pytest.param("time.sleep(60)", "agent-failed (timeout): i13_ins_sl_minor_road", marks=pytest.mark.full),
    ],
)
def test_verdicts_of_hostile_agents(run: Run, tmp_path: Path, deed: str, verdict: str) -> None:
    agents = HOSTILE.format(sensors="", deed=deed).encode()
    archive = written(tmp_path, packed(dict(GOOD) | {"agents.py": agents}))
    found = run(
        "submit", archive, "--dry-run", "--suite", "interdrive@0", "--scenario", "i13*", "--workers", 1, "--out", "out"
    )
    assert found.exit_code == 0, found.output
    assert verdict in found.output


@boxed
@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("kind", ["privileged", "rgb"])
def test_what_is_asked_for_only_while_driving_is_rejected(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """An agent that behaves when it is asked, and not later: here a file tells it, elsewhere the clock may."""
    later = f'SensorSpec("{kind}") if os.path.exists("/agent/src/later") else SensorSpec("gnss"),'
    agents = HOSTILE.format(sensors=later, deed="pass").encode()
    archive = written(tmp_path, packed(dict(GOOD) | {"agents.py": agents, "src/x.py": b""}))
    ask = dry_run.ask_agent

    def asked(entrant: SubmittedAgent) -> AgentDeclaration:
        found = ask(entrant)
        (entrant.folder / "src" / "later").touch()
        return found

    monkeypatch.setattr(dry_run, "ask_agent", asked)
    found = run(
        "submit", archive, "--dry-run", "--suite", "interdrive@0", "--scenario", "i13*", "--workers", 1, "--out", "out"
    )
    assert found.exit_code == 2, found.output
    assert "rejected: i13_ins_sl_minor_road: " in found.output


def test_messages_reach_the_receivers_that_the_track_allows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    asked: list[CommSettings] = []

    class Idle:
        def __init__(self, *_: object) -> None: ...
        def __enter__(self) -> "Idle":
            return self

        def __exit__(self, *_: object) -> None: ...
        def run(self, jobs: list[EpisodeJob]) -> list[object]:
            asked.extend(job.options.comm for job in jobs)
            return []

    monkeypatch.setattr(dry_run, "ProcessPool", type("P", (), {"__class_getitem__": classmethod(lambda cls, _: Idle)}))
    manifest = check_archive(written(tmp_path, packed(GOOD)), ArchiveLimits())
    course = dry_run.DryRunOptions("interdrive@0", "i13*", 0, 1, tmp_path / "out")
    for track in ChallengeTrack:
        assert list(dry_run.run_jobs(SubmittedAgent(manifest, tmp_path, HERE), track, course)) == []
    assert asked == [COMM_BY_TRACK[track] for track in ChallengeTrack]


@pytest.mark.usefixtures("in_process")
def test_a_scenario_that_changes_during_a_dry_run_is_noticed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No agent is started: the suite is compared before."""
    path = make_suite(tmp_path / "suite", "nap").find_scenario_file("s0")

    def change_and_run(job: EpisodeJob) -> ScenarioResult:
        path.write_bytes(path.read_bytes() + b"\n")
        return run_job(job)

    monkeypatch.setattr(dry_run, "run_dry_job", change_and_run)
    manifest = check_archive(written(tmp_path, packed(GOOD)), ArchiveLimits())
    course = dry_run.DryRunOptions(str(tmp_path / "suite"), "*", 0, 1, tmp_path / "out")
    jobs = dry_run.run_jobs(SubmittedAgent(manifest, tmp_path, HERE), ChallengeTrack.SINGLE, course)
    said = f"{path}: expected the scenario with which the run began, found a changed one"
    assert [outcome for _, outcome in jobs] == [WorkerFailure(FailureKind.INPUT, said)]

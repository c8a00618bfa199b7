"""Who has ended a program: itself, its limits, or a signal from outside of its box."""

import logging
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from testing.sandbox_runs import (
    PATIENCE_S,
    find_supervisor,
    left_behind,
    needs_bubblewrap,
    needs_root,
    own_slot,
    shell_spec,
)
from testing.short_suite import make_short_suite

from mdrive_sumo.agent_process.child_process import AgentBox, BoxedAgentProcess
from mdrive_sumo.agent_process.sandbox import Box, BoxError, BoxKilledError, BoxReport, open_box
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import declare_agent
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring.results import ScenarioResult

SLOT = own_slot()
WAITING = "echo here >&3; while :; do sleep 1; done"
shell = partial(shell_spec, slot=SLOT)
pytestmark = [pytest.mark.slow, needs_bubblewrap]
needs_runsc = pytest.mark.skipif(shutil.which("runsc") is None, reason="needs gVisor's runsc")


@pytest.fixture(autouse=True)
def hang_ups_end_programs() -> Iterator[None]:
    """`nohup` ignores SIGHUP for all that it starts, and programs in boxes inherit that."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def parents() -> dict[int, int]:
    """Parent of each process of the host."""
    found: dict[int, int] = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            found[int(file.parent.name)] = int(file.read_text().rpartition(")")[2].split()[1])
        except OSError:  # gone meanwhile
            continue
    return found


def child_of(pid: int) -> int:
    """The first child of a process, once there is one."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        children = sorted(child for child, parent in parents().items() if parent == pid)
        if children:
            return children[0]
        time.sleep(0.01)
    raise AssertionError(f"process {pid} has no child")


def launched(box: Box) -> int:
    return box.pid


def first_process(box: Box) -> int:
    return child_of(box.pid)


def program(box: Box) -> int:
    return child_of(child_of(box.pid))


def gvisors_kernel(box: Box) -> int:
    """`runsc` starts itself again as root of a user namespace; the file server and the kernel are children of that."""
    again = child_of(box.pid)
    return next(
        child
        for child, parent in parents().items()
        if parent == again and b"runsc-sandbox" in Path(f"/proc/{child}/cmdline").read_bytes()
    )


def end_of(box: Box) -> BoxReport:
    """What a box reports once its program is gone by itself."""
    end_by_itself(box)
    return box.close()


def end_by_itself(box: Box) -> None:
    end = time.monotonic() + PATIENCE_S
    while box.alive() and time.monotonic() < end:
        time.sleep(0.01)
    assert not box.alive()


def killed(spec_of: Callable[..., Box], find: Callable[[Box], int], number: int) -> BoxReport:
    with spec_of() as box:
        assert box.ready(PATIENCE_S) and box.socket.recv(10) == b"here\n"
        os.kill(find(box), number)
        return end_of(box)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_kill_of_bubblewrap_is_always_ours(number: int) -> None:
    """Nothing in a box reaches this process, so no program can bring it about."""
    for owns in (False, True):
        with pytest.raises(BoxError, match=f"ended by signal {int(number)} from outside") as caught:
            killed(lambda owns=owns: open_box(shell(WAITING, owns_signals=owns)), launched, number)
        assert not isinstance(caught.value, BoxKilledError)
    assert left_behind(SLOT) == []


@pytest.mark.parametrize(
    ("find", "number"),
    [(first_process, signal.SIGKILL), (program, signal.SIGKILL), (program, signal.SIGTERM), (program, signal.SIGHUP)],
)
def test_a_kill_in_the_box_is_ours_once(find: Callable[[Box], int], number: int) -> None:
    with pytest.raises(BoxKilledError, match=f"signal {int(number)}, which may have come from outside"):
        killed(lambda: open_box(shell(WAITING)), find, number)
    report = killed(lambda: open_box(shell(WAITING, owns_signals=True)), find, number)
    assert (report.signal, report.clean) == (number, True)
    assert left_behind(SLOT) == []


@pytest.mark.parametrize("name", ["SEGV", "ABRT", "BUS", "FPE", "ILL", "SYS", "XCPU", "XFSZ", "USR1", "ALRM"])
def test_a_fault_is_the_programs_own(name: str) -> None:
    with open_box(shell(f"kill -{name} $$")) as box:
        assert end_of(box).signal == signal.Signals[f"SIG{name}"]


def test_a_program_that_kills_itself_may_do_so_once() -> None:
    with open_box(shell("kill -KILL $$")) as box, pytest.raises(BoxKilledError):
        end_of(box)
    with open_box(shell("kill -KILL $$", owns_signals=True)) as box:
        assert end_of(box).signal == signal.SIGKILL


def test_an_exit_after_close_has_begun_is_no_kill() -> None:
    with open_box(shell(WAITING)) as box:
        assert box.ready(PATIENCE_S)
        assert box.close().signal == signal.SIGKILL  # ours, and asked for


@needs_runsc
def test_a_kill_of_gvisors_processes_is_ours() -> None:
    boxed = partial(open_box, shell(WAITING, backend="gvisor"))
    with pytest.raises(BoxError, match="gVisor failed: ended by signal 9 from outside"):
        killed(boxed, launched, signal.SIGKILL)
    with pytest.raises(BoxKilledError, match="may have come from outside"):
        killed(boxed, gvisors_kernel, signal.SIGKILL)
    again = partial(open_box, shell(WAITING, backend="gvisor", owns_signals=True))
    assert killed(again, gvisors_kernel, signal.SIGKILL).signal == signal.SIGKILL
    with open_box(shell("kill -SEGV $$", backend="gvisor")) as box:
        assert end_of(box).signal == signal.SIGSEGV
    assert left_behind(SLOT) == []


AGENT = """
import os, signal
from mdrive_sumo.contract import Control, Reply
class Driver:
    label = "single"
    def __init__(self, config): {create}
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        if seen.tick == 20: {act}
        return Reply(control=Control(0.5, 0.0, 0.0))
"""
SELF_KILL = "os.kill(os.getpid(), signal.SIGKILL)"


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("kills") / "suite", "i01_*", metres=8)


def job_of(suite: Path, folder: Path, create: str = "pass", act: str = "pass") -> EpisodeJob:
    folder.chmod(0o755)
    (folder / "agent").mkdir(exist_ok=True)
    (folder / "agent" / "agents.py").write_text(AGENT.format(create=create, act=act))
    (folder / "logs").mkdir(exist_ok=True)
    box = AgentBox(folder / "agent", python=sys.executable, site=Path(np.__file__).parents[1])
    scenario = load_suite(str(suite)).scenarios[0].id
    agent = AgentSpec("/agent/agents.py:Driver", box=box)
    return EpisodeJob(suite, scenario, agent, logs=folder / "logs")


def count_boxes(monkeypatch: pytest.MonkeyPatch, deed: Callable[[int, BoxedAgentProcess], None]) -> list[int]:
    """Calls `deed` with the number of each box that is opened from now on, and the box."""
    opened: list[int] = []
    begin = BoxedAgentProcess.__init__

    def counted(process: BoxedAgentProcess, *arguments: object) -> None:
        begin(process, *arguments)  # pyright: ignore[reportArgumentType]
        opened.append(process._box.pid)
        deed(len(opened), process)

    monkeypatch.setattr(BoxedAgentProcess, "__init__", counted)
    return opened


def test_an_episode_whose_box_is_killed_is_driven_again_with_the_same_result(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    job = job_of(suite, tmp_path)
    undisturbed = run_job(job)

    def kill_first(number: int, process: BoxedAgentProcess) -> None:
        if number == 1:
            agent = program(process._box)
            while b"bwrap" in Path(f"/proc/{agent}/cmdline").read_bytes().partition(b"\0")[0]:
                time.sleep(0.01)  # bubblewrap, whose own command line ends with the agent's, has not begun it yet
            os.kill(agent, signal.SIGKILL)

    opened = count_boxes(monkeypatch, kill_first)
    with caplog.at_level(logging.WARNING):
        assert run_job(job) == undisturbed
    assert was_driven_twice(opened, undisturbed)
    assert "signal 9, which may have come from outside; the episode is driven once more" in caplog.text


def test_an_episode_whose_supervisor_is_killed_is_driven_again(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The agent fails without it; that was scored as the agent's crash."""
    needs_root()
    job = job_of(suite, tmp_path, act="os.fstat(0)")
    undisturbed = run_job(job)
    opened = count_boxes(monkeypatch, kill_supervisor_of_the_first)
    with caplog.at_level(logging.WARNING):
        assert run_job(job) == undisturbed
    assert End.AGENT_FAILED not in {ego.outcome for ego in undisturbed.egos}
    assert was_driven_twice(opened, undisturbed)
    assert "the supervisor of the box was ended by a signal" in caplog.text


def was_driven_twice(opened: list[int], result: ScenarioResult) -> bool:
    """The first box may be found dead before the next one is opened."""
    return len(result.egos) < len(opened) <= 2 * len(result.egos)


def kill_supervisor_of_the_first(number: int, process: BoxedAgentProcess) -> None:
    if number == 1:
        supervisor = find_supervisor(process._box)
        os.kill(supervisor, signal.SIGKILL)


def test_an_agent_that_kills_itself_fails_after_one_repetition(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = job_of(suite, tmp_path, act=SELF_KILL)
    opened = count_boxes(monkeypatch, lambda *_: None)
    result = run_job(job)
    assert {ego.outcome for ego in result.egos} == {End.AGENT_FAILED}
    assert "crashed: act: the agent's process ended (exit code -9)" in result.egos[0].reason
    assert len(opened) == 2 * len(result.egos)
    records = [path.read_text() for path in (tmp_path / "logs").glob("*.json")]
    assert len(records) == len(result.egos) and all('"repeated": true' in text for text in records)


def test_a_kill_of_bubblewrap_voids_the_episode(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count_boxes(monkeypatch, lambda _, process: os.kill(process._box.pid, signal.SIGKILL))
    with pytest.raises(WorldError, match="bubblewrap failed: ended by signal 9 from outside"):
        run_job(job_of(suite, tmp_path))


def test_a_killed_box_has_a_record_although_closing_it_fails(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A connection is closed once: by the failure of another one of its episode, or by its own end."""

    def kill_and_close(_: int, process: BoxedAgentProcess) -> None:
        os.kill(process._box.pid, signal.SIGKILL)
        end_by_itself(process._box)
        with pytest.raises(BoxError, match="ended by signal 9 from outside"):
            process.close()
        assert process.usage_record()["signal"] == signal.SIGKILL
        raise WorldError("looked at")

    count_boxes(monkeypatch, kill_and_close)
    with pytest.raises(WorldError, match="looked at"):
        run_job(job_of(suite, tmp_path))


def test_an_agent_that_kills_itself_when_it_is_created_is_declared_crashed(suite: Path, tmp_path: Path) -> None:
    from mdrive_sumo.loop.agent_driver import AgentFailure

    with pytest.raises(AgentFailure, match="exit code -9"):
        declare_agent(job_of(suite, tmp_path, create=SELF_KILL).agent)

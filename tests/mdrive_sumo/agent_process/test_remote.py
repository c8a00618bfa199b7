"""Third-party agents in a child process: whatever they do, it ends them and nothing else."""

import time
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.agent_process.child_process import AgentProgram
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.contract import Observation, OwnState, PointCloud
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure

pytestmark = pytest.mark.slow

AGENT = """
import ctypes, os, sys, time
import numpy as np
from mdrive_sumo.contract import Control, Plan, Reply, SensorSpec

class Driver:
    label = "single"
    def __init__(self, config): self.mode = config.get("mode", "good")
    def sensors(self): return (SensorSpec("objects", range_m=30.0),)
    def start(self, briefing): pass
    def act(self, seen):
        print("a line on standard output")
        if self.mode == "good": return Reply(control=Control(0.25, 0.0, 0.1))
        if self.mode == "plan": return Reply(plan=Plan(np.array([[1.0, 2.0]]), 0.2))
        if self.mode == "raise": raise RuntimeError("my planner\\nfailed")
        if self.mode == "exit": os._exit(3)
        if self.mode == "sysexit": sys.exit("done")
        if self.mode == "sleep": time.sleep(60)
        if self.mode == "c-sleep": ctypes.PyDLL(None).sleep(60)
        if self.mode == "segfault": ctypes.string_at(0)
        if self.mode == "object": return object()
        if self.mode == "none": return None
        if self.mode == "nan": return Reply(control=Control(float("nan"), 0.0, 0.0))
        if self.mode == "huge": return Reply(plan=Plan(np.zeros((4_500_000, 2)), 0.2))
        if self.mode == "garbage":
            for fd in range(3, 500):
                try: os.write(fd, b"garbage" * 10)
                except OSError: pass
            return None

class Joint(Driver):
    label = "best"

class Broken(Driver):
    def __init__(self, config): raise ValueError("no such weights")
"""
COUNTS = """
import resource
from mdrive_sumo.contract import Control, Reply

class Counts:
    label = "single"
    def __init__(self, config): self.faults = 0
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        before, self.faults = self.faults, resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        return Reply(control=Control(min(1.0, (self.faults - before) / 1000), 0.0, 0.0))
"""
SEEN = Observation(0, OwnState(0, 0, 0, 0, 0, 0, 0))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("agent") / "mine.py"
    file.write_text(AGENT)
    return file


def driver(path: Path, mode: str, name: str = "Driver", **limits: float) -> RemoteDriver:
    return RemoteDriver(open_agent_connection(AgentProgram(f"{path}:{name}"), AgentLimits(**limits)), {"mode": mode})


def test_a_good_agent_answers(path: Path, tmp_path: Path) -> None:
    remote = RemoteDriver(
        open_agent_connection(AgentProgram(f"{path}:Driver", log=tmp_path / "log"), AgentLimits()), {}
    )
    assert remote.label == "single"
    assert remote.sensors()[0].range_m == 30.0
    for _ in range(3):
        remote.ask(SEEN)
        control = remote.answer().control
        assert control is not None
        assert (control.throttle, control.steer) == (0.25, 0.1)
    remote.close()
    assert (tmp_path / "log").read_text() == "a line on standard output\n" * 3


def test_the_memory_of_an_observation_is_kept_for_the_next(tmp_path: Path) -> None:
    """Given back to the kernel, the 90 pages of a LiDAR's points would be asked for anew with every tick."""
    (tmp_path / "counts.py").write_text(COUNTS)
    remote = RemoteDriver(open_agent_connection(AgentProgram(f"{tmp_path}/counts.py:Counts"), AgentLimits()), {})
    remote.sensors()
    faults: list[float] = []
    for tick in range(60):
        cloud = PointCloud(np.zeros((23_000 + 200 * (tick % 10), 4), np.float32), np.zeros(0, np.int32), ())
        remote.ask(Observation(tick, OwnState(0, 0, 0, 0, 0, 0, 0), lidar={"top": cloud}))
        control = remote.answer().control
        assert control is not None
        faults.append(1000 * control.throttle)
    remote.close()
    assert np.median(faults[30:]) < 10, faults


def test_a_plan_crosses_with_its_array(path: Path) -> None:
    remote = driver(path, "plan")
    remote.sensors()
    remote.ask(SEEN)
    plan = remote.answer().plan
    assert plan is not None
    assert plan.points.tolist() == [[1.0, 2.0]]
    remote.close()


@pytest.mark.parametrize(
    ("mode", "failure", "text"),
    [
        ("raise", FailureReason.CRASHED, "RuntimeError: my planner failed"),
        ("exit", FailureReason.CRASHED, "act: the agent's process ended (exit code 3)"),
        pytest.param("sysexit", FailureReason.CRASHED, "SystemExit: done", marks=pytest.mark.full),
        ("sleep", FailureReason.TIMEOUT, "act: no answer within the time limit"),
        ("c-sleep", FailureReason.TIMEOUT, "act: no answer within the time limit"),
        ("segfault", FailureReason.CRASHED, "act: the agent's process ended (exit code -11)"),
        pytest.param(
            "object",
            FailureReason.INVALID,
            "act: expected a value of the contract, found object",
            marks=pytest.mark.full,
        ),
        ("none", FailureReason.INVALID, "expected a Reply, found NoneType"),
        ("nan", FailureReason.INVALID, "throttle: expected a number in [0, 1], found nan"),
        ("huge", FailureReason.INVALID, "act: expected an answer of at most"),
        ("garbage", FailureReason.INVALID, "act: "),
    ],
)
def test_a_bad_agent_fails_with_its_reason(path: Path, mode: str, failure: FailureReason, text: str) -> None:
    remote = driver(path, mode, tick_s=3.0 if failure is FailureReason.TIMEOUT else 120.0)
    remote.sensors()
    begin = time.monotonic()
    with pytest.raises(AgentFailure) as caught:
        remote.ask(SEEN)
        remote.answer()
    assert (caught.value.failure, caught.value.text[: len(text)]) == (failure, text)
    assert time.monotonic() - begin < 60.0
    remote.close()


def test_an_episode_has_a_time_limit_too(path: Path) -> None:
    remote = driver(path, "sleep", tick_s=30.0, episode_s=0.5)
    remote.sensors()
    remote.ask(SEEN)
    with pytest.raises(AgentFailure, match="time limit"):
        remote.answer()


@pytest.mark.parametrize(
    ("locator", "failure", "text"),
    [
        ("{path}:Broken", FailureReason.CRASHED, "ValueError: no such weights"),
        ("{path}:Nobody", FailureReason.CRASHED, "InputError: expected a class"),
        ("/no/file.py:Driver", FailureReason.CRASHED, "InputError: agent file file.py: expected a Python file"),
        ("no.such.module:Driver", FailureReason.CRASHED, "InputError: agent module 'no.such.module'"),
    ],
)
def test_an_agent_that_cannot_be_made(path: Path, locator: str, failure: FailureReason, text: str) -> None:
    remote = RemoteDriver(open_agent_connection(AgentProgram(locator.format(path=path)), AgentLimits()), {})
    with pytest.raises(AgentFailure) as caught:
        remote.sensors()
    assert (caught.value.failure, caught.value.text[: len(text)]) == (failure, text)


def test_an_unknown_label_is_invalid(path: Path) -> None:
    remote = driver(path, "good", "Joint")
    with pytest.raises(AgentFailure, match="label: expected one of single"):
        _ = remote.label

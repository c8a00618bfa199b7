"""Third-party agents in boxes: good ones drive as in a plain child, abuses end with their documented verdicts."""

import json
import os
import pickle
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing import carla_agents
from testing.hostile_protocol import CASES, DEEDS, LATE, write_agent
from testing.sampling import sampled
from testing.sandbox_runs import needs_bubblewrap
from testing.short_suite import make_short_suite

from mdrive_sumo.agent_process import frame_file
from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.contract import Control, Message, Observation, OwnState, PointCloud
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError, declare_agent, open_agents
from mdrive_sumo.scenario.suite import load_suite

SITE = Path(np.__file__).parents[1]
OWN = OwnState(0, 0, 0, 0, 0, 0, 0)
NAMES = [*DEEDS, "stale", "result", "deep-and-wide", "nan"]
USUAL = ("slowloris", "noread", "huge", "early", "descriptors", "chatter", "segfault", "half", "terminal", "nan")
"""One of each way to fail. Beside these, `test_wire_replies` reads every bad answer, `test_remote_line` has lines that
end or stay empty, a job in boxes has `exit`, and tests of hostile programs stop one that spins."""
boxed = needs_bubblewrap
pytestmark = pytest.mark.slow


def box(folder: Path, **limits: int) -> AgentBox:
    return AgentBox(folder, python=sys.executable, site=SITE, limits=BoxLimits(**limits))


def driver(folder: Path, limits: AgentLimits, **box_limits: int) -> RemoteDriver:
    program = AgentProgram("/agent/agents.py:Driver", log=folder / "log")
    return RemoteDriver(open_agent_connection(program, limits, box(folder, **box_limits)), {})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What a user without rights can read, as an extracted archive."""
    made = tmp_path / "agent"
    made.mkdir(mode=0o755)
    return made


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    memory = tmp_path / "memory"
    memory.mkdir()
    monkeypatch.setattr(frame_file, "MEMORY", memory)
    yield
    assert list(memory.iterdir()) == []


def drive(remote: RemoteDriver, tick: int, large: bool) -> Control | None:
    messages = tuple(Message("cam", bytes(2**20)) for _ in range(32)) if large else ()
    remote.ask(Observation(tick, OWN, messages=messages))
    return remote.answer().control


@pytest.mark.parametrize("where", [pytest.param("plain", marks=pytest.mark.full), pytest.param("box", marks=boxed)])
@pytest.mark.parametrize("name", sampled(NAMES, USUAL))
def test_an_abuse_ends_with_its_verdict(name: str, where: str, folder: Path) -> None:
    case = CASES[name]
    path = write_agent(folder, name)
    limits = AgentLimits(tick_s=case.tick_s)
    if where == "box":
        remote = driver(folder, limits)
    else:
        remote = RemoteDriver(open_agent_connection(AgentProgram(f"{path}:Driver"), limits), {})
    assert remote.sensors() == ()
    for tick in range(LATE):
        assert drive(remote, tick, False) == Control(0.25, 0.0, 0.1)
    begin = time.monotonic()
    if case.failure is None:
        assert drive(remote, LATE, False) == Control(0.25, 0.0, 0.1)
    else:
        with pytest.raises(AgentFailure) as caught:
            for tick in range(LATE, LATE + 3):
                drive(remote, tick, name == "noread" and tick > LATE)
                time.sleep(0.3)  # the rest of a tick: what comes meanwhile comes early
        assert (caught.value.failure, caught.value.text[: len(case.text)]) == (case.failure, case.text)
        assert len(caught.value.text) <= 250 and caught.value.text.isprintable()
    remote.close()
    assert time.monotonic() - begin < 60.0


CURIOUS = """
import os
import numpy as np
from mdrive_sumo.contract import Control, Reply, SensorSpec

class Driver:
    label = "single"
    def __init__(self, config): self.sums = []
    def sensors(self): return (SensorSpec("lidar", "top"),)
    def start(self, briefing): pass
    def act(self, seen):
        if seen.tick == 0:
            for name in ("/frames/0", "/kit/mdrive_sumo/__init__.py", "/agent/agents.py", "/site/numpy/__init__.py"):
                try: os.close(os.open(name, os.O_RDWR)); print("WRITABLE", name)
                except OSError as error: print(type(error).__name__, error.errno, name)
            print(sorted(os.listdir("/")), os.path.exists("/kit/mdrive_sumo/scenarios"), os.getuid())
            import mdrive_sumo.vehicle.control, mdrive_sumo.v2x.messages
        return Reply(control=Control(0.0, 0.0, float(seen.lidar["top"].points[0, 0])))
"""


@boxed
@pytest.mark.parametrize("backend", ["bubblewrap", "gvisor"])
def test_a_boxed_agent_reads_its_frames_and_nothing_else(folder: Path, backend: str) -> None:
    if backend == "gvisor" and shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    (folder / "agents.py").write_text(CURIOUS)
    program = AgentProgram("/agent/agents.py:Driver", log=folder / "log")
    remote = RemoteDriver(open_agent_connection(program, AgentLimits(), replace(box(folder), backend=backend)), {})
    assert remote.sensors()[0].kind == "lidar"
    for tick in range(4):
        points = np.full((60_000, 4), tick / 10, dtype=np.float32)
        remote.ask(Observation(tick, OWN, lidar={"top": PointCloud(points, np.zeros(0, dtype=np.int32), ())}))
        control = remote.answer().control
        assert control is not None and control.steer == tick / 10
    remote.close()
    log = (folder / "log").read_text()
    assert "WRITABLE" not in log and log.count("OSError 30") + log.count("PermissionError 13") == 4
    assert "'frames'" in log and "'agent'" in log and " False " in log and "'root'" not in log and "'home'" not in log
    record = remote.usage_record()
    assert (record["backend"], record["answers"], record["failure"], record["clean"]) == (backend, 4, "", True)


HUNGRY = """
class Driver:
    label = "single"
    def __init__(self, config): self.all = []
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        while True: self.all.append(bytearray(b"x" * 2**24))
"""


@boxed
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_out_of_memory_is_the_agents_failure(folder: Path) -> None:
    (folder / "agents.py").write_text(HUNGRY)
    remote = driver(folder, AgentLimits(tick_s=60.0), memory_bytes=150_000_000)
    remote.sensors()
    with pytest.raises(AgentFailure) as caught:
        drive(remote, 0, False)
    assert caught.value.failure is FailureReason.CRASHED
    assert caught.value.text in ("act: the agent's process ended (out of memory)", "MemoryError:")
    assert remote.usage_record()["oom_killed"] is True


@boxed
def test_drivers_of_a_job_in_boxes_leave_a_record_and_a_log(tmp_path: Path, folder: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    write_agent(folder, "exit", late=1)
    spec = AgentSpec("/agent/agents.py:Driver", box=box(folder))
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert declare_agent(spec).label == "single"
    with open_agents(spec, {"a": "77", "b": "66"}, logs / "crossing") as drivers:
        for ego in ("a", "b"):
            drivers[ego].sensors()
            drivers[ego].ask(Observation(0, OWN))
            drivers[ego].answer()
        drivers["a"].ask(Observation(1, OWN))
        with pytest.raises(AgentFailure, match="exit code 0"):
            drivers["a"].answer()
    records = {ego: json.loads((logs / f"crossing.{ego}.json").read_text()) for ego in ("a", "b")}
    assert records["a"]["failure"] == "act: the agent's process ended (exit code 0)" and not records["b"]["failure"]
    assert all((logs / f"crossing.{ego}.log").is_file() for ego in ("a", "b"))


KILLER = """
import os, signal, time
class Driver:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        if not os.path.isdir("/kit") or os.getpid() > 100: return None  # not in a box: spare the machine
        for number in (signal.SIGTERM, signal.SIGSEGV, signal.SIGABRT, signal.SIGINT, signal.SIGKILL): TARGET
        os._exit(3)
"""


@boxed
@pytest.mark.parametrize("target", ["os.kill(1, number)", "os.kill(-1, number)", "os.killpg(0, number)"])
def test_an_agent_cannot_make_its_end_ours(folder: Path, target: str) -> None:
    """Whichever process it kills, itself and the first process of its box included: it is the agent that failed.

    At the latest when its episode is repeated (`test_sandbox_kills`), because nothing tells who has sent a signal.
    """
    (folder / "agents.py").write_text(KILLER.replace("TARGET", target))
    program = AgentProgram("/agent/agents.py:Driver", log=folder / "log")
    remote = RemoteDriver(open_agent_connection(program, AgentLimits(), replace(box(folder), owns_signals=True)), {})
    remote.sensors()
    with pytest.raises(AgentFailure, match=r"process ended \(exit code|No such process") as caught:
        drive(remote, 0, False)
    assert caught.value.failure is FailureReason.CRASHED


DIARY = """
import os, time
from mdrive_sumo.contract import Control, Reply, SensorSpec

class Driver:
    label = "single"
    def __init__(self, config):
        self.found = [name for folder in ("/tmp", "/dev/shm") for name in os.listdir(folder)]
        for folder in ("/tmp", "/dev/shm"): open(folder + "/diary", "w").write("crossing 7: brake at 3 s")
    def sensors(self): return (SensorSpec("privileged"),) if time.time() > WHEN else ()
    def start(self, briefing): pass
    def act(self, seen): return Reply(control=Control(0.0, 0.0, len(self.found) / 10))
"""


@boxed
def test_nothing_of_an_earlier_run_is_found(folder: Path) -> None:
    (folder / "agents.py").write_text(DIARY.replace("WHEN", "1e12"))
    for _ in range(2):
        remote = driver(folder, AgentLimits())
        remote.sensors()
        assert drive(remote, 0, False) == Control(0.0, 0.0, 0.0)
        remote.close()


@boxed
@pytest.mark.parametrize(
    ("agent", "text"),
    [
        (DIARY.replace("WHEN", "0"), "sensor 'privileged': expected sensors that a car can have"),
        (DIARY.replace("WHEN", "0").replace("privileged", "rgb"), "found another name of a camera"),
        (DIARY.replace("WHEN", "0").replace('"privileged"', '"lidar", options={"range": 9.0}'), "option 'range'"),
    ],
    ids=("privileged", "camera", "option"),
)
def test_a_sensor_asked_for_in_a_race_only_is_refused_there(folder: Path, agent: str, text: str) -> None:
    """An agent may behave until a date: what it declares is looked at in every run."""
    (folder / "agents.py").write_text(agent)
    suite = load_suite("interdrive@0")
    for name, error, message in (
        ("/agent/agents.py:Driver", RejectedError, text),
        ("omniscient", InputError, "expected a third-party agent for a box"),
    ):
        with pytest.raises(error, match=message):
            run_job(EpisodeJob(suite.folder, suite.scenarios[0].id, AgentSpec(name, box=box(folder))))


@boxed
def test_a_scenario_driven_in_boxes_is_the_same_bit_for_bit(folder: Path, tmp_path: Path) -> None:
    (folder / "agents.py").write_text("from mdrive_sumo.agents.sharing import SharingAgent as Driver\n")
    suite = load_suite(str(make_short_suite(tmp_path / "suite", "i01_*", metres=25)))
    plain = EpisodeJob(suite.folder, suite.scenarios[0].id, AgentSpec("sharing"), 3)
    inside = replace(plain, agent=AgentSpec("/agent/agents.py:Driver", box=box(folder)), logs=tmp_path)
    results = [run_job(job) for job in (plain, inside)]
    assert results[0].digest == results[1].digest
    assert results[0] == results[1]
    records = [json.loads(path.read_text()) for path in tmp_path.glob("*.json")]
    assert len(records) == len(suite.scenarios[0].egos)
    assert all(record["failure"] == "" and record["answers"] > 50 for record in records)


@boxed
def test_a_joint_agent_drives_a_scenario_in_one_box(folder: Path, tmp_path: Path) -> None:
    carla_agents.write(folder, carla_agents.FOLLOWER)
    suite = load_suite(str(make_short_suite(tmp_path / "suite", "i01_*", metres=25)))
    agent = AgentSpec("carla:/agent/agents.py", box=box(folder))
    result = run_job(EpisodeJob(suite.folder, suite.scenarios[0].id, agent, logs=tmp_path))
    assert result.rc > 50.0 and "agent-failed" not in result.model_dump_json()
    [record] = [json.loads(path.read_text()) for path in tmp_path.glob("*.all.json")]
    assert record["failure"] == "" and record["answers"] > 50 and record["clean"]

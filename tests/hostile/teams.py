"""The archives of hostile agents, as a team would send them."""

import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

from testing import hostile_protocol
from testing.archive_samples import ENV, Info, packed
from testing.sandbox_runs import AGENTS

DRIVER = """\
import json, os, runpy, sys, time
from mdrive_sumo.contract import Control, Message, Note, Reply, SensorSpec
sys.path.insert(0, "/agent/src")

def run(name, *arguments):
    sys.argv = [name, *arguments]
    runpy.run_path("/agent/src/" + name + ".py", run_name="__main__")

class Agent:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return {sensors}
    def start(self, briefing): {start}
    def act(self, seen):
        if seen.tick == 3: {act}
        return Reply(control=Control({throttle}, 0.0, 0.0){more})
"""
MANY_RASTERS = 'tuple(SensorSpec("bev", id=str(i), options={"size": 1024}) for i in range(64))'
GOSSIP = ', messages=tuple(Message("text", os.urandom(900)) for _ in range(60))'
NOTES = ', notes=tuple(Note("note", os.urandom(60).hex()) for _ in range(300))'
KINDS_OF_NOTES = ', notes=tuple(Note(os.urandom(3).hex(), "x") for _ in range(1500))'
RASTERS = 'tuple(SensorSpec("bev", id=str(i), options={"size": 1024}) for i in range(8))'
JOINT = b"""\
import time

def get_entry_point(): return "Mine"

class Mine:
    def setup(self, *_): pass
    def sensors(self): return []
    def set_global_plan(self, *_): pass
    def run_step(self, *_): time.sleep(600)
"""
TELL = """

def tell(**facts):
    print("TOLD " + json.dumps(facts), flush=True)
"""
"""Through a server descriptor 3 is the line to the evaluator: what a program found goes into its log."""
IN_ACT = ("forkbomb", "threadbomb", "inodes")
"""Programs that never end by themselves; the others are run before the first tick, where time is not short."""

MARKER = "marker-of-a-hidden-scenario"


def driver(start: str = "pass", act: str = "pass", sensors: str = "()", throttle: str = "0.5", more: str = "") -> bytes:
    """The file of an agent that drives straight on, and does these things."""
    return DRIVER.format(start=start, act=act, sensors=sensors, throttle=throttle, more=more).encode()


def team(source: bytes, **files: bytes) -> bytes:
    """An archive of one agent."""
    return packed(
        {"agents.py": source, "model_env.yaml": ENV} | {f"src/{name}.py": data for name, data in files.items()}
    )


def with_program(name: str, *arguments: str) -> bytes:
    """An archive with a program of `hostile/agents`, which drives on when that ends."""
    call = f"run({name!r}, *{arguments!r})"
    throttle = "0.0" if name == "impostor" else "0.5"
    source = driver(act=call, throttle=throttle) if name in IN_ACT else driver(start=call, throttle=throttle)
    tell = (AGENTS / "tell.py").read_bytes() + TELL.encode()
    return team(source, tell=tell, **{name: (AGENTS / f"{name}.py").read_bytes()})


def with_set_uid_program() -> bytes:
    """The program that `setuid` runs as /tools/id, in the archive instead."""

    def add(archive: zipfile.ZipFile) -> None:
        info = Info("src/id")
        info.external_attr = (stat.S_IFREG | 0o4755) << 16
        archive.writestr(info, Path("/usr/bin/id").read_bytes())

    program = (AGENTS / "setuid.py").read_bytes().replace(b"/tools/id", b"/agent/src/id")
    tell = (AGENTS / "tell.py").read_bytes() + TELL.encode()
    files = {"agents.py": driver(start="run('setuid')"), "model_env.yaml": ENV, "src/tell.py": tell}
    return packed(files | {"src/setuid.py": program}, add)


def with_abuse(name: str, scratch: Path) -> bytes:
    """An archive with an abuse of the protocol."""
    source = hostile_protocol.write_agent(scratch, name).read_bytes()
    return team(source.replace(b"class Driver:", b"class Agent:"))


def drivers(date_s: float) -> Mapping[str, bytes]:
    """Whole agents. `date_s`: when one of them changes its ways."""
    return {
        "leaves-at-import": team(b"import os\nos._exit(7)\n" + driver()),
        "breaks-at-import": team(b"def :\n" + driver()),
        "privileged": team(driver(sensors='(SensorSpec("privileged"),)')),
        "camera": team(driver(sensors='(SensorSpec("camera", options={"width": 3000, "height": 3000}),)')),
        "gossip": team(driver(more=GOSSIP, throttle="0.0")),
        "archivist": team(driver(more=NOTES, throttle="0.0")),
        "printer": team(driver(act="pass\n        while True: os.write(1, b'x' * 65536)")),
        "labeller": team(driver(more=KINDS_OF_NOTES, throttle="0.0")),
        "glutton": team(driver(sensors=MANY_RASTERS)),
        "painter": team(driver(sensors=RASTERS)),
        "joint-sleeper": team(JOINT),
        "until-a-date": team(driver(throttle=f"0.5 if time.time() < {date_s!r} else 0.1")),
    }


def blabber() -> bytes:
    """Says everything it knows, wherever somebody may look, and breaks off with it."""
    told = f"('{MARKER}', briefing.route_xy.tolist())"
    return team(driver(start=f"print({told}, flush=True); raise ValueError(str({told}))"))

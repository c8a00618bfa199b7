"""What tests let a small interpreter of its own do: it joins control groups whose limits the worker of pytest exceeds.

A worker grows with the tests that it has run; the limit would end a copy of it (`fork`) before anything happens.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import BoxError, cgroups, open_box
from mdrive_sumo.agent_process.sandbox.cgroups import join_episode_group
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from testing.paths import ROOT, TESTS
from testing.sandbox_runs import MEBIBYTE, SMALL, processes_of, shell_spec


def call_in_small_interpreter(function: str, *arguments: object) -> object:
    """Return what a function of this module returns in a new interpreter, through JSON."""
    code = (
        "import json, sys; from testing import group_members;"
        " print(json.dumps(getattr(group_members, sys.argv[1])(*json.loads(sys.argv[2]))))"
    )
    command = [sys.executable, "-c", code, function, json.dumps(arguments)]
    env = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(TESTS)))}
    ended = subprocess.run(command, env=env, stdout=subprocess.PIPE, text=True, timeout=300, check=True)
    return json.loads(ended.stdout)


def fill_episode_group(slot: int) -> list[object]:
    """Join an episode's group of 64 MiB, open a box, and let a child need more.

    Returns whether the group was joined, twice; whether the box's group lies beside it; the child's status; own pid.
    """
    hierarchy = cgroups.find_hierarchy()
    assert hierarchy is not None
    joined = join_episode_group(64 * MEBIBYTE), join_episode_group(64 * MEBIBYTE)
    with open_box(shell_spec("sleep 600", limits=SMALL, slot=slot)) as box:
        beside = (hierarchy.folders["memory"] / f"mdrive-box-{box.slot}").is_dir()
    pid = os.fork()  # the kernel would end the largest process of the group, that is this one
    if pid == 0:
        Path("/proc/self/oom_score_adj").write_text("1000")
        held = bytearray(b"x") * (100 * MEBIBYTE)
        os._exit(len(held) and 0)
    return [*joined, beside, os.waitpid(pid, 0)[1], os.getpid()]


def starve_box(outer: str, slot: int) -> str:
    """Join the group `outer`, limit it to 400 MiB, and let a box need more; return who is blamed."""
    Path(outer, "cgroup.procs").write_text("0")
    Path(outer, "memory.limit_in_bytes").write_text(str(400 * MEBIBYTE))
    spec = shell_spec("read -r wait <&3; a=xxxxxxxx; while :; do a=$a$a; done", slot=slot)
    try:
        with open_box(spec) as box:
            for pid in processes_of(FIRST_UID + box.slot):
                Path(f"/proc/{pid}/oom_score_adj").write_text("1000")
            box.socket.sendall(b"go\n")
            box.ready(30.0)
            box.close()
    except BoxError as error:
        return str(error)
    return "the agent's"

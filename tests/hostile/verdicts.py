"""The hostile programs of `agents` that need only a box, and what must come of each."""

from dataclasses import replace

from testing.sandbox_runs import MEBIBYTE, SMALL, Expected

KILLED, OUT_OF_CPU, FAULT = 9, 24, 11
NOTHING: dict[str, object] = {"open": []}

VERDICTS = {
    "kernel": Expected(told=NOTHING, exit_code=0),
    "procs": Expected(told={"seen": [1, 2], "groups": [], "parent": 1}, exit_code=0),
    "forkbomb": Expected(at_most={"count": SMALL.processes}, signals=(KILLED,), stays=True),
    "threadbomb": Expected(at_most={"count": SMALL.processes}, signals=(KILLED,), stays=True),
    "membomb": Expected(signals=(KILLED,), oom=True, needs=("cgroup",)),
    "scapegoat": Expected(signals=(KILLED,), oom=True, needs=("cgroup",)),
    "membomb_fork": Expected(told={"all_killed": True}, exit_code=0, oom=True, slow=True, needs=("cgroup",)),
    "inodes": Expected(
        limits=replace(SMALL, memory_bytes=32 * MEBIBYTE), signals=(KILLED,), oom=True, slow=True, needs=("cgroup",)
    ),
    "diskfill": Expected(
        told={"one_ended": "EFBIG", "ended": "ENOSPC"},
        at_most={"one": SMALL.file_bytes, "total": SMALL.tmp_bytes},
        exit_code=0,
    ),
    "shmbomb": Expected(
        told={"file": [SMALL.file_bytes, "EFBIG"], "unnamed": [SMALL.file_bytes, "EFBIG"]}, exit_code=0
    ),
    "stdoutflood": Expected(told={"written": True}, exit_code=0),
    "daemon": Expected(told={"left": True}, exit_code=0),
    "selfexit": Expected(exit_code=0),
    "segv": Expected(signals=(FAULT,)),
    "spin": Expected(limits=replace(SMALL, cpu_s=1), signals=(OUT_OF_CPU,), slow=True),
}
"""`net`, `files` and `setuid` need something made for them; their tests stand beside the others."""

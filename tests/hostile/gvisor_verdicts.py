"""What must come of the hostile programs of `agents` in a box of gVisor, where it differs from bubblewrap's.

gVisor's own kernel answers most calls, so that a program may succeed with what bubblewrap's filter refuses: it then has
a namespace, a lock or a socket of that kernel, which lives and dies with its box.
"""

from dataclasses import replace

from hostile.verdicts import KILLED, VERDICTS
from testing.sandbox_runs import MEBIBYTE, SMALL, Expected

MEMORY_ERROR = Expected(exit_code=1)
"""Memory is limited for each process inside: an error of the program, and no kill."""

GVISOR_VERDICTS = {
    **{name: VERDICTS[name] for name in ("diskfill", "shmbomb", "daemon", "selfexit", "segv")},
    # Process 1 is the program itself: its kill ends the box.
    "procs": Expected(told={"seen": [1], "groups": [], "parent": 0}, signals=(KILLED,)),
    "forkbomb": VERDICTS["forkbomb"],
    "threadbomb": VERDICTS["threadbomb"],
    "membomb": MEMORY_ERROR,
    "scapegoat": MEMORY_ERROR,
    "membomb_fork": Expected(exit_code=0),
    "inodes": replace(VERDICTS["inodes"], limits=replace(SMALL, memory_bytes=32 * MEBIBYTE)),
}
"""`kernel`, `net`, `files`, `setuid`, `spin` and `stdoutflood` have tests of their own."""

ANSWERED_INSIDE = frozenset(
    {
        *("unshare user", "unshare mounts", "clone user", "io_uring_setup", "mknod", "setuid", "terminal"),
        *("netlink with high bits", "flock", "lock of a record", "lock of a record with high bits", "inotify_init"),
        *("io_setup", "fadvise64", "mincore", "sync_file_range", "sync", "sysinfo", "statfs", "fstatfs", "statx"),
        *("credentials with messages", "process descriptors with messages", "clone with a process descriptor"),
        *("fstatat of a path with AT_EMPTY_PATH", "sched_setaffinity", "membarrier", "get_mempolicy"),
        *("merge equal pages", "huge page", "huge page in shared memory"),
    }
)
"""Calls of `kernel` that gVisor's kernel answers itself. All others are refused as under bubblewrap."""

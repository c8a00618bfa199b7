"""The table of system calls that a box is refused, each with its reason. `seccomp` makes the filter of it.

The default is to allow, up to the newest call that this table was written for: what a later kernel brings is answered
as if the kernel did not know it.
"""

import errno
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SyscallRule:
    """Calls refused for one reason."""

    reason: str
    calls: tuple[str, ...]
    answer: int = errno.EPERM


@dataclass(frozen=True, slots=True)
class ArgumentRule:
    """A call refused for some values of its arguments only."""

    reason: str
    call: str
    arguments: tuple[tuple[int, int], ...]
    """Position and value of each; the kernel looks at 32 bits of them, and so must the filter."""


REFUSALS = (
    SyscallRule("reads, writes or traces another process", ("ptrace", "process_vm_readv", "process_vm_writev")),
    SyscallRule("advises the kernel about another process's memory", ("process_madvise", "process_mrelease")),
    SyscallRule("compares kernel objects of two processes, which leaks addresses", ("kcmp",)),
    SyscallRule("takes file descriptors out of another process", ("pidfd_open", "pidfd_getfd")),
    SyscallRule("makes or enters namespaces, where one has every capability", ("unshare", "setns")),
    SyscallRule("changes what is mounted", ("mount", "umount2", "pivot_root", "chroot", "mount_setattr")),
    SyscallRule("changes what is mounted", ("fsopen", "fsmount", "fsconfig", "fspick", "move_mount")),
    SyscallRule("changes what is mounted", ("open_tree", "open_tree_attr")),
    SyscallRule("loads programs into the kernel", ("bpf",)),
    SyscallRule("measures other programs; large and often faulty", ("perf_event_open",)),
    SyscallRule("runs calls past this filter", ("io_uring_setup", "io_uring_enter", "io_uring_register")),
    SyscallRule("stops the kernel in the middle of a copy, a tool of exploits", ("userfaultfd",)),
    SyscallRule("keyrings are not divided by namespaces", ("keyctl", "add_key", "request_key")),
    SyscallRule("memory that no one can account for or look into", ("memfd_secret",)),
    SyscallRule("watches files of the whole mount", ("fanotify_init", "fanotify_mark")),
    SyscallRule("sees that another box opens a file", ("inotify_init", "inotify_init1", "inotify_add_watch")),
    SyscallRule("sees that another box opens a file", ("inotify_rm_watch",)),
    SyscallRule("a lock on a shared file carries data", ("flock",)),
    SyscallRule("counted for all of the host", ("io_setup", "io_destroy", "io_submit", "io_cancel")),
    SyscallRule("counted for all of the host", ("io_getevents", "io_pgetevents")),
    SyscallRule("reads or changes which pages of a file are in memory", ("mincore", "cachestat", "readahead")),
    SyscallRule("reads or changes which pages of a file are in memory", ("fadvise64", "sync_file_range")),
    SyscallRule("waits for all writing of the host", ("sync", "syncfs")),
    SyscallRule("tells free memory and load of the host", ("sysinfo",)),
    SyscallRule("tells free space of file systems of the host", ("statfs", "fstatfs")),
    SyscallRule("lists mounts and namespaces", ("statmount", "listmount", "listns")),
    SyscallRule("another kernel", ("kexec_load", "kexec_file_load", "reboot")),
    SyscallRule("kernel modules", ("init_module", "finit_module", "delete_module")),
    SyscallRule("swap and disk quotas of the host", ("swapon", "swapoff", "quotactl", "quotactl_fd")),
    SyscallRule("accounts and log of the host", ("acct", "syslog")),
    SyscallRule("hangs up the host's terminal", ("vhangup",)),
    SyscallRule("ports of the hardware", ("iopl", "ioperm")),
    SyscallRule("names the host", ("sethostname", "setdomainname")),
    SyscallRule("sets the host's clock", ("clock_settime", "settimeofday", "adjtimex", "clock_adjtime")),
    SyscallRule("opens files past the mounts", ("open_by_handle_at", "name_to_handle_at")),
    SyscallRule("device nodes", ("mknod", "mknodat")),
    SyscallRule("switches off address randomisation and other guards", ("personality",)),
    SyscallRule("segments of 16-bit programs, often faulty", ("modify_ldt",)),
    SyscallRule("places memory on the host's nodes", ("move_pages", "mbind", "set_mempolicy", "migrate_pages")),
    SyscallRule("places memory on the host's nodes", ("set_mempolicy_home_node",)),
    SyscallRule("nothing has used it for decades", ("uselib", "ustat", "sysfs", "lookup_dcookie", "nfsservctl")),
    SyscallRule("nothing has used it for decades", ("_sysctl", "create_module", "get_kernel_syms", "query_module")),
    SyscallRule("chooses the processor, whose counters and caches others read", ("sched_setaffinity",)),
    SyscallRule("changes how the processor serves others", ("sched_setattr", "sched_setscheduler", "sched_setparam")),
    SyscallRule("interrupts the processors on which others run", ("membarrier",), errno.ENOSYS),
    SyscallRule("tells on which node of the host memory lies", ("get_mempolicy",), errno.ENOSYS),
    SyscallRule("tells numbers of mounts and inodes; C libraries fall back to `fstatat`", ("statx",), errno.ENOSYS),
    SyscallRule("its flags lie behind a pointer; C libraries fall back to `clone`", ("clone3",), errno.ENOSYS),
)

NUMBERS = {
    "process_mrelease": 448,
    "set_mempolicy_home_node": 450,
    "cachestat": 451,
    "statmount": 457,
    "listmount": 458,
    "open_tree_attr": 467,
    "listns": 470,
}
"""For a libseccomp that does not know the name yet. From 424 on, numbers are the same on all architectures (source:
`scripts/syscall.tbl` of Linux)."""

LAST_KNOWN = 470
"""`listns` of Linux 6.19. Larger numbers are answered ENOSYS."""
LAST_OLD = ("rseq", "kexec_file_load")
"""The largest number below 424 is one of these (x86-64: 334, ARM64: 294); those between are answered ENOSYS too."""

ALLOWED_IOCTLS = (0x5421, 0x541B, 0x5450, 0x5451)
"""FIONBIO, FIONREAD, FIONCLEX, FIOCLEX. All others are answered ENOTTY: they ask for the generation of an inode, the
place of a file on its disk, the entropy of the host, namespaces, or need a terminal, which no box has."""

CLONE_PIDFD = 0x1000
"""Refused to `clone`: the inode of a process descriptor counts the processes of the host."""

NAMESPACE_FLAGS = (0x00020000, 0x02000000, 0x04000000, 0x08000000, 0x10000000, 0x20000000, 0x40000000)
"""CLONE_NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET: refused to `clone` as `unshare` is."""

FCNTL_LOCKS = (5, 6, 7, 36, 37, 38, 1024, 1025)
"""F_GETLK, F_SETLK, F_SETLKW, F_OFD_GETLK, F_OFD_SETLK, F_OFD_SETLKW, F_SETLEASE, F_GETLEASE."""
FCNTL_SIGNALS = (8, 10, 15, 1026)
"""F_SETOWN, F_SETSIG, F_SETOWN_EX, F_NOTIFY."""
FCNTL_HINTS = (1035, 1036, 1037, 1038)
"""F_GET_RW_HINT, F_SET_RW_HINT, F_GET_FILE_RW_HINT, F_SET_FILE_RW_HINT: stored with the inode."""
FCNTL_LAST = 1038
"""Commands above it are newer (F_GETDELEG, F_SETDELEG are locks) or have high bits that the kernel ignores."""

COOKIES = (("SO_COOKIE", 57), ("SO_NETNS_COOKIE", 71), ("SO_PEERPIDFD", 77))
PASSED = (("SO_PASSCRED", 16), ("SO_PASSPIDFD", 76))
"""A socket with SO_PASSCRED is given a name by a counter (kernels before 6.1)."""
SOCKET_OPTION_LAST = 84
"""SO_INQ of Linux 6.18. `getsockopt` of newer ones is refused. Source: `asm-generic/socket.h`."""
ADVICE = (
    ("merges pages that are equal in two boxes (MADV_MERGEABLE)", 12),
    ("moves pages to the host's swap (MADV_COLD)", 20),
    ("moves pages to the host's swap (MADV_PAGEOUT)", 21),
    ("tells whether the host has a large page free (MADV_COLLAPSE)", 25),
)
PRCTLS = (
    ("a cookie made of a kernel address (PR_SCHED_CORE)", 62),
    ("merges pages that are equal in two boxes (PR_SET_MEMORY_MERGE)", 67),
)
HUGE_PAGES = (("mmap", 3, 0x40000), ("memfd_create", 1, 0x4), ("shmget", 2, 0o4000))
"""Call, position and flag that takes pages of the host's pool: MAP_HUGETLB, MFD_HUGETLB, SHM_HUGETLB."""
SHORTEST_NAME = 3
"""Bytes: a shorter address has `bind` choose a name by a counter of the host (kernels before 6.1)."""

REFUSED_ARGUMENTS = (
    *(ArgumentRule("a lock on a shared file carries data", "fcntl", ((1, value),)) for value in FCNTL_LOCKS),
    *(ArgumentRule("is told what another box does to a file", "fcntl", ((1, value),)) for value in FCNTL_SIGNALS),
    *(ArgumentRule("kept with the file, for all to read", "fcntl", ((1, value),)) for value in FCNTL_HINTS),
    *(
        ArgumentRule(f"{name} counts for all of the host", "getsockopt", ((1, 1), (2, value)))
        for name, value in COOKIES
    ),
    *(
        ArgumentRule(f"{name} gives sockets names or descriptors", "setsockopt", ((1, 1), (2, value)))
        for name, value in PASSED
    ),
    *(ArgumentRule(reason, "madvise", ((2, value),)) for reason, value in ADVICE),
    *(ArgumentRule(reason, "prctl", ((0, value),)) for reason, value in PRCTLS),
)
"""Every number is the same on x86-64 and ARM64."""

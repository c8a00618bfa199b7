"""System calls that a box is refused, each with its reason, and the filter that refuses them.

The default is to allow: a call that a newer kernel brings is allowed until it is listed here. Programs of the other
word size (32-bit entry, x32) are refused every call, because the list names calls by the native numbers only.
"""

import errno
import socket
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mdrive_sumo.core.errors import InputError


@dataclass(frozen=True, slots=True)
class SyscallRule:
    """Calls refused for one reason."""

    reason: str
    calls: tuple[str, ...]
    answer: int = errno.EPERM


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
    SyscallRule("its flags lie behind a pointer; C libraries fall back to `clone`", ("clone3",), errno.ENOSYS),
)

NAMESPACE_FLAGS = (0x00020000, 0x02000000, 0x04000000, 0x08000000, 0x10000000, 0x20000000, 0x40000000)
"""CLONE_NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET: refused to `clone` as `unshare` is."""

TERMINAL_REQUESTS = (0x5412, 0x541C)
"""TIOCSTI and TIOCLINUX of `ioctl`: type into a terminal in another's name."""

LOW_32 = 0xFFFFFFFF
"""The kernel looks at 32 bits of an `ioctl` request; so must the filter."""


@cache
def compiled() -> bytes:
    """The filter as the kernel wants it. Compiled once in a process.

    Raises InputError if pyseccomp or the library under it is missing.
    """
    try:
        import pyseccomp as seccomp
    except (ImportError, RuntimeError, OSError) as error:
        cure = "pip install 'mdrive-sumo[server]', on Debian and Ubuntu: apt-get install libseccomp2"
        raise InputError(f"sandbox: expected the package pyseccomp and libseccomp, found: {error}; {cure}") from error
    rules = seccomp.SyscallFilter(seccomp.ALLOW)
    rules.set_attr(seccomp.Attr.ACT_BADARCH, seccomp.ERRNO(errno.EPERM))
    refused = seccomp.ERRNO(errno.EPERM)
    for refusal in REFUSALS:
        for call in refusal.calls:
            if seccomp.resolve_syscall(seccomp.Arch.NATIVE, call) != -1:
                rules.add_rule(seccomp.ERRNO(refusal.answer), call)
    for flag in NAMESPACE_FLAGS:
        rules.add_rule(refused, "clone", seccomp.Arg(0, seccomp.MASKED_EQ, flag, flag))
    for request in TERMINAL_REQUESTS:
        rules.add_rule(refused, "ioctl", seccomp.Arg(1, seccomp.MASKED_EQ, LOW_32, request))
    for call in ("socket", "socketpair"):
        rules.add_rule(refused, call, seccomp.Arg(0, seccomp.NE, socket.AF_UNIX))
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "filter").open("w+b") as file:
        rules.export_bpf(file)
        file.seek(0)
        return file.read()

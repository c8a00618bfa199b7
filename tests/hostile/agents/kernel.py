"""Asks the kernel for what a driving program never needs; numbers of x86-64."""

import ctypes
import errno
import mmap
import os
import resource
import socket
from functools import partial

from tell import opened, syscall, tell

NEWUSER, NEWNS = 0x10000000, 0x00020000
buffer = ctypes.create_string_buffer(4096)
memory = os.memfd_create("x")
os.write(memory, bytes(4096))
vector = (ctypes.c_void_p * 2)(ctypes.addressof(buffer), 16)
unnamed = socket.socket(socket.AF_UNIX)
mapped = mmap.mmap(-1, 4096)
page = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(mapped)))


def own(number: int, *arguments: object) -> bool:
    """In a child: a call that succeeds may change its caller."""
    pid = os.fork()
    if pid == 0:
        os._exit(0 if syscall(number, *arguments) else 1)
    return os.waitpid(pid, 0)[1] == 0


def clones(flags: int) -> bool:
    libc = ctypes.CDLL(None, use_errno=True)
    pid = libc.syscall(ctypes.c_long(56), ctypes.c_long(flags | 17), None, None, None, None)
    if pid == 0:
        os._exit(0)
    return pid > 0


def raises_limit() -> bool:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard + 1))
    return True


def runs_32_bit() -> bool:
    """getpid through the 32-bit entry: the filter counts calls by the numbers of 64 bits."""
    code = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    code.write(bytes.fromhex("b814000000cd80c3"))  # mov eax, 20; int 0x80; ret
    address = ctypes.addressof(ctypes.c_char.from_buffer(code))
    pid = os.fork()
    if pid == 0:
        os._exit(0 if ctypes.CFUNCTYPE(ctypes.c_int)(address)() == os.getpid() else 1)
    return os.waitpid(pid, 0)[1] == 0


def is_known(number: int) -> bool:
    """Whether a call is answered by anything but ENOSYS."""
    libc = ctypes.CDLL(None, use_errno=True)
    return libc.syscall(ctypes.c_long(number)) >= 0 or ctypes.get_errno() != errno.ENOSYS


def attr(size: int) -> object:
    return ctypes.byref(ctypes.create_string_buffer(size.to_bytes(4, "little") * 2, 128))


tell(
    open=opened(
        {
            "ptrace": partial(own, 101, 16, 1, 0, 0),  # PTRACE_ATTACH to the box's first process
            "process_vm_readv": partial(own, 310, os.getppid(), buffer, 1, buffer, 1, 0),
            "pidfd_open": partial(own, 434, 1, 0),
            "kcmp": partial(own, 312, os.getpid(), os.getpid(), 0, 0, 0),
            "unshare user": partial(own, 272, NEWUSER),
            "unshare mounts": partial(own, 272, NEWNS),
            "clone user": partial(clones, NEWUSER),
            "clone3": partial(own, 435, buffer, 88),
            "mount": partial(own, 165, buffer, b"/tmp", b"tmpfs", 0, None),
            "open_tree": partial(own, 428, -100, b"/usr", 1),
            "chroot": partial(own, 161, b"/tmp"),
            "bpf": partial(own, 321, 0, attr(1), 128),
            "perf_event_open": partial(own, 298, attr(1), 0, -1, -1, 0),
            "io_uring_setup": partial(own, 425, 4, ctypes.create_string_buffer(256)),
            "userfaultfd": partial(own, 323, 1),
            "keyctl": partial(own, 250, 0, -3, 1),
            "add_key": partial(own, 248, b"user", b"k", b"v", 1, -3),
            "memfd_secret": partial(own, 447, 0),
            "personality": partial(own, 135, 0x0040000),
            "modify_ldt": partial(own, 154, 0, buffer, 64),
            "mknod": partial(own, 133, b"/tmp/node", 0o20666, 0x0103),
            "name_to_handle_at": partial(own, 303, -100, b"/usr", attr(128), buffer, 0),
            "setuid": partial(own, 105, 0),
            "setns": partial(own, 308, 3, 0),
            "sethostname": partial(own, 170, b"x", 1),
            "type into a terminal": partial(own, 16, 0, 0x5412, buffer),
            "the same with high bits": partial(own, 16, 0, 0x700005412, buffer),
            "netlink with high bits": partial(own, 41, (1 << 32) | int(socket.AF_NETLINK), 3, 0),
            "raise a limit": raises_limit,
            "32-bit entry": runs_32_bit,
            "flock": partial(own, 73, 3, 1),
            "lock of a record": partial(own, 72, 3, 5, buffer),
            "lock of a record with high bits": partial(own, 72, 3, (1 << 32) | 5, buffer),
            "lock of an open file": partial(own, 72, 3, 36, buffer),
            "lease": partial(own, 72, 3, 1025, 0),
            "delegation": partial(own, 72, 3, 1039, buffer),
            "hint of a file": partial(own, 72, 3, 1037, buffer),
            "notify": partial(own, 72, 3, 1026, 0),
            "inotify_init": partial(own, 294, 0),
            "fanotify_init": partial(own, 300, 0, 0),
            "io_setup": partial(own, 206, 1, ctypes.byref(ctypes.c_ulong(0))),
            "preadv2 with flags": partial(own, 327, memory, vector, 1, 0, 0, 8),
            "fadvise64": partial(own, 221, memory, 0, 0, 4),
            "readahead": partial(own, 187, memory, 0, 4096),
            "mincore": partial(own, 27, page, 4096, buffer),
            "cachestat": partial(own, 451, memory, (ctypes.c_uint64 * 2)(0, 4096), buffer, 0),
            "sync_file_range": partial(own, 277, memory, 0, 0, 0),
            "sync": partial(own, 162),
            "sysinfo": partial(own, 99, buffer),
            "statfs": partial(own, 137, b"/", buffer),
            "fstatfs": partial(own, 138, memory, buffer),
            "statmount": partial(own, 457, (ctypes.c_uint64 * 3)(24, 1, 1), buffer, 4096, 0),
            "listmount": partial(own, 458, (ctypes.c_uint64 * 3)(24, (1 << 64) - 1, 0), buffer, 8, 0),
            "open_tree_attr": partial(own, 467, -100, b"/", 1, buffer, 32),
            "socket cookie": partial(own, 55, 3, 1, 57, buffer, ctypes.byref(ctypes.c_int(8))),
            "terminal": lambda: os.open("/dev/ptmx", os.O_RDWR) > 0,
            "x32 entry": partial(own, 0x40000000 + 39),
            "cookie of a network": partial(own, 55, 3, 1, 71, buffer, ctypes.byref(ctypes.c_int(8))),
            "descriptor of the other process": partial(own, 55, 3, 1, 77, buffer, ctypes.byref(ctypes.c_int(4))),
            "unknown socket option": partial(own, 55, 3, 1, 99, buffer, ctypes.byref(ctypes.c_int(4))),
            "credentials with messages": partial(own, 54, unnamed.fileno(), 1, 16, attr(4), 4),
            "process descriptors with messages": partial(own, 54, unnamed.fileno(), 1, 76, attr(4), 4),
            "name chosen by the kernel": partial(own, 49, unnamed.fileno(), b"\x01\x00", 2),
            "clone with a process descriptor": partial(clones, 0x1000),
            "statx": partial(own, 332, memory, b"", 0x1000, 0xFFF, buffer),
            "fstatat of a path with AT_EMPTY_PATH": partial(own, 262, -100, b"/", buffer, 0x1000),
            "sched_setaffinity": partial(own, 203, 0, 8, attr(1)),
            "sched_setattr": partial(own, 314, 0, ctypes.create_string_buffer(b"\x38", 56), 0),
            "sched_setscheduler": partial(own, 144, 0, 3, attr(0)),
            "core scheduling": partial(own, 157, 62, 0, 0, 0, page),
            "membarrier": partial(own, 324, 0, 0, 0),
            "get_mempolicy": partial(own, 239, None, None, 0, 0, 0),
            "merge equal pages": partial(own, 28, page, 4096, 12),
            "move a page to swap": partial(own, 28, page, 4096, 21),
            "collapse pages": partial(own, 28, page, 4096, 25),
            "merge all equal pages": partial(own, 157, 67, 1, 0, 0, 0),
            "huge page": partial(own, 9, 0, 1 << 21, 3, 0x40022, -1, 0),
            "huge page in a memory file": partial(own, 319, b"x", 4),
            "huge page in shared memory": partial(own, 29, 0, 1 << 21, 0o5600),
            "generation of an inode": partial(own, 16, memory, 0x80087601, buffer),
            "entropy of the host": lambda: own(16, os.open("/dev/urandom", os.O_RDONLY), 0x80045200, buffer),
            "call of a newer kernel": partial(is_known, 471),
            "call between the tables": partial(is_known, 400),
        }
    )
)

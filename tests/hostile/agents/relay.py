"""Sends and receives one bit at a time through whatever two boxes may have in common; numbers of x86-64.

Its evaluator says what to do, a line each: `arm`, `send 0`, `send 1`, `read` or `rest`, with the name of a channel. The
answer to `read` is what the receiver sees, null if it may not look; of a number it is the number, if nothing was armed.
argv: a file that all boxes are shown.
"""

import json
import os
import socket
from contextlib import suppress

from relay_channels.base import Channel
from relay_channels.files import (
    AioCount,
    ByCachestat,
    ByMincore,
    ByNowait,
    ByReadahead,
    ByTime,
    DeviceLock,
    DeviceTimes,
    Flock,
    Futex,
    HostMemory,
    Inotify,
    OpenFileLock,
    RecordLock,
    SharedPages,
)
from relay_channels.numbers import (
    ByDescriptorInfo,
    ByFstatat,
    ByFstatatWithHighBits,
    ByLink,
    ByPath,
    ByRace,
    ByStatx,
    FileInode,
    FileInodeByPath,
    MemoryFileInode,
    PipeInode,
    ProcessDescriptor,
    ProcessInode,
    ProcessNumber,
    SharedMemoryInode,
    SharedMemoryKey,
    SocketCookie,
    SocketInode,
)

CHANNELS: dict[str, Channel] = {
    "record lock": RecordLock(),
    "open file lock": OpenFileLock(),
    "flock": Flock(),
    "lock of a device": DeviceLock(),
    "inotify": Inotify(),
    "aio-nr": AioCount(),
    "residency by mincore": ByMincore(),
    "residency by cachestat": ByCachestat(),
    "residency by RWF_NOWAIT": ByNowait(),
    "residency by time": ByTime(),
    "residency by readahead": ByReadahead(),
    "futex": Futex(),
    "shared pages": SharedPages(),
    "times of a device": DeviceTimes(),
    "memory of the host": HostMemory(),
    "inode of a pipe": PipeInode(),
    "inode of a pipe by fstatat": ByFstatat(),
    "inode of a pipe by fstatat with high bits": ByFstatatWithHighBits(),
    "inode of a pipe by statx": ByStatx(),
    "inode of a pipe by a link of /proc": ByLink(),
    "inode of a pipe by a path of /dev": ByPath(),
    "inode of a pipe by fdinfo": ByDescriptorInfo(),
    "inode of a pipe by a race": ByRace(),
    "inode of a socket": SocketInode(),
    "inode of a memory file": MemoryFileInode(),
    "inode of shared memory": SharedMemoryInode(),
    "inode in /proc": ProcessInode(),
    "inode of a process descriptor": ProcessDescriptor(),
    "number of a process": ProcessNumber(),
    "cookie of a socket": SocketCookie(),
    "key of shared memory": SharedMemoryKey(),
    "inode of a file in memory": FileInode(),
    "inode of a file in memory by path": FileInodeByPath(),
}


with suppress(OSError):  # the kernel counts some numbers for each processor
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def obey(words: list[str]) -> object:
    channel = CHANNELS[" ".join(words[1:]) if words[0] != "send" else " ".join(words[2:])]
    with suppress(OSError, LookupError, AttributeError, ValueError, StopIteration):
        return channel.send(int(words[1])) if words[0] == "send" else getattr(channel, words[0])()
    return None


with socket.socket(fileno=3) as evaluator, evaluator.makefile("rw") as lines:
    for line in lines:
        lines.write(json.dumps(obey(line.split())) + "\n")
        lines.flush()

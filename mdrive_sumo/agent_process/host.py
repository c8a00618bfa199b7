"""The main program of an agent's process: `python -m mdrive_sumo.agent_process.host STYLE LOCATOR FD FRAMES`.

It answers framed requests on the socket FD with one answer each, stamped with the tick of the request; large arrays of
a request are in the folder FRAMES. It imports nothing heavier than numpy and msgpack, because boxes may have nothing
else.
"""

# ruff: noqa: E402
import gc

gc.disable()  # nothing of what is imported here becomes garbage: looking for it took a twentieth of the start

import os
from importlib.machinery import SourceFileLoader


def _read_module_file(self: SourceFileLoader, path: str) -> bytes:  # noqa: ARG001 (the loader's signature)
    """Read a module as `get_data` of its loader does, without the two `fstat` of a Python file.

    In a box a supervisor answers each; those of 160 modules took 12 ms of the start.
    """
    file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    try:
        data = b""
        while part := os.read(file, AT_ONCE):
            data += part
        return data
    finally:
        os.close(file)


AT_ONCE = 2**16
"""Read at once [bytes]: an observation without large arrays, and most modules, are a few thousand."""
SourceFileLoader.get_data = _read_module_file

import ctypes
import pickle
import signal
import sys
from collections.abc import Callable, Mapping
from io import TextIOWrapper
from pathlib import Path
from typing import Any, cast

from mdrive_sumo.agent_process import wire_protocol
from mdrive_sumo.agent_process.agent_lookup import load_agent_class
from mdrive_sumo.agent_process.frame_reader import FrameReader
from mdrive_sumo.contract import Agent, read_label, read_sensors

PR_SET_PDEATHSIG = 1
"""Source: `linux/prctl.h`."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Source: `malloc.h` of glibc."""
HEAP_ARRAY_BYTES, KEPT_BYTES = 2**22, 2**24
"""Arrays up to the first come from the heap, of which the second stays when it is freed. Chosen: a LiDAR scan has
0.4 MB, and images of the largest camera rigs, which are more, are few."""
Handler = Callable[[str, Any], Any]


def main() -> None:
    """Serve one agent until the connection is closed. An exception of the agent is an answer, not a traceback."""
    style, locator, fd, frames = sys.argv[1:]
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # never outlive a killed worker
        _keep_freed_memory(libc)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    cast(TextIOWrapper, sys.stdout).reconfigure(line_buffering=True)  # the agent's output survives its end
    line, reader = int(fd), FrameReader(frames)
    os.set_inheritable(line, False)
    handle = _handle_carla_agent(locator, style) if style.startswith("carla") else _handle_agent(locator, style)
    sys.argv = sys.argv[:1]
    gc.freeze()
    gc.enable()
    while (data := _read_request(line)) is not None:
        request = wire_protocol.decode(data, reader.load)
        _write_all(line, _answer_request(handle, request))


def _keep_freed_memory(libc: ctypes.CDLL) -> None:
    """Keep freed memory for the next observation.

    By default glibc returns the arrays of an observation to the kernel and requests them again for the next, page by
    page: that took longer (0.1 ms) than copying them. musl has no such options.
    """
    if hasattr(libc, "mallopt"):
        libc.mallopt(M_MMAP_THRESHOLD, HEAP_ARRAY_BYTES)
        libc.mallopt(M_TRIM_THRESHOLD, KEPT_BYTES)


def _read_request(line: int) -> memoryview | None:
    """Return one request without its length; None at the end of the stream.

    Usually one system call: requests and answers alternate, so nothing follows a request. The module `socket` would be
    loaded for two functions of it.
    """
    data, head = os.read(line, AT_ONCE), wire_protocol.LENGTH.size
    while data and len(data) < head:
        more = os.read(line, AT_ONCE)
        data = data + more if more else b""
    if not data:
        return None
    size = head + wire_protocol.LENGTH.unpack_from(data)[0]
    return memoryview(data)[head:] if len(data) == size else _read_rest(line, data, size)


def _read_rest(line: int, begin: bytes, size: int) -> memoryview | None:
    """Return a request of which `begin` has been read; size: with its length [bytes]."""
    data = bytearray(size)
    data[: len(begin)] = begin
    left = memoryview(data)[len(begin) :]
    while left:
        count = os.readv(line, [left])
        if not count:
            return None
        left = left[count:]
    return memoryview(data)[wire_protocol.LENGTH.size :]


def _write_all(line: int, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[os.write(line, left) :]


def _answer_request(handle: Handler, request: Mapping[str, Any]) -> bytes:
    tick = request["tick"]
    try:
        answer = handle(request["call"], request["value"])
    except BaseException as error:  # noqa: BLE001 (the border to a participant's code; SystemExit included)
        import traceback

        traceback.print_exc()
        return wire_protocol.encode_frame({"tick": tick, "crashed": f"{type(error).__name__}: {error}"[:1000]})
    try:
        return wire_protocol.encode_frame({"tick": tick, "value": answer})
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        return wire_protocol.encode_frame({"tick": tick, "invalid": str(error)[:1000]})


def _handle_agent(locator: str, style: str) -> Handler:
    """Return the handler of an `Agent` for one CAV, whose class a locator names or a file of style "pickle" holds."""
    agent: list[Agent] = []

    def handle(call: str, value: Any) -> Any:
        if call == "create":
            cls = _unpickle_agent_class(Path(locator)) if style == "pickle" else load_agent_class(locator)
            agent.append(cls(value))
            return {"label": read_label(agent[0]), "sensors": read_sensors(agent[0])}
        if call == "start":
            agent[0].start(value)
            return None
        return agent[0].act(value)

    return handle


def _unpickle_agent_class(path: Path) -> Callable[[Mapping[str, Any]], Agent]:
    """Return the class that the user's own process has written; it finds modules where that process does."""
    sys.path[:], pickled = pickle.loads(path.read_bytes())
    return pickle.loads(pickled)


def _handle_carla_agent(path: str, style: str) -> Handler:
    """Return the handler of an agent of the CARLA leaderboard: for all CAVs, of style "carla-single" for one."""
    from mdrive_sumo.agent_process.carla_adapter import CarlaAgentAdapter

    agent: list[CarlaAgentAdapter] = []

    def handle(call: str, value: Any) -> Any:
        if call == "create":
            is_single = style == "carla-single"
            agent.append(CarlaAgentAdapter(path, value["config"], value["cavs"], is_single=is_single))
            return {"label": "single" if is_single else "joint", "sensors": agent[0].sensors()}
        if call == "start":
            agent[0].start(value["briefings"], value["gps"])
            return None
        return agent[0].act(value)

    return handle


if __name__ == "__main__":
    main()

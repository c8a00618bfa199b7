"""Which backend boxes have on this machine: a kernel for each box where that works and is fast enough."""

import shutil
import statistics
import time
from dataclasses import dataclass
from functools import lru_cache

from mdrive_sumo.agent_process.sandbox.box_spec import BACKENDS, BoxSpec
from mdrive_sumo.agent_process.sandbox.gvisor import find_platform
from mdrive_sumo.agent_process.sandbox.open_box import open_in_any_thread
from mdrive_sumo.core.errors import InputError, WorldError

AUTO = "auto"
"""Not a backend: gVisor where its trial succeeds, else bubblewrap."""

OWN_KERNEL, SHARED_KERNEL = "gvisor", "bubblewrap"
"""The backend whose boxes have a kernel each, and the fallback, whose boxes share that of the host."""

START_S = 10.0
"""A box of the trial must begin within this; measured 0.2 s, and 1.3 s on a machine with load 12."""

ROUND_TRIPS = 40
"""Words that are sent, of whose times the median counts: 8 ms in all."""
ROUND_TRIP_S = 0.005
"""Median time for a word to a shell in the box and back; measured 0.2 ms. Beyond it a tick of 20 Hz loses a tenth."""

ANSWER_S = 5.0
"""For each word; a platform that hangs, as `kvm` does, never answers."""

ECHO = 'while read -r word <&3; do echo "$word" >&3; done'


@dataclass(frozen=True, slots=True)
class KernelTrial:
    """Whether this machine can give each box a kernel of its own, found by opening one."""

    succeeded: bool
    detail: str
    """Program, platform and times, or why not."""


def try_own_kernel() -> KernelTrial:
    """Open a box of gVisor and speak with it; once a process for each `runsc`, at most for some seconds."""
    program = shutil.which("runsc")
    return KernelTrial(False, "runsc (gVisor) is not installed") if program is None else _try(program)


@lru_cache(maxsize=4)
def _try(program: str) -> KernelTrial:
    platform = find_platform(program)
    named = f"{program}, platform {platform}"
    begun_s = time.monotonic()
    try:
        box = open_in_any_thread(BoxSpec(("/bin/sh", "-c", ECHO), {}, backend=OWN_KERNEL), START_S)
        start_ms = 1000 * (time.monotonic() - begun_s)
        times_s: list[float] = []
        with box:
            for number in range(ROUND_TRIPS):
                asked_s = time.monotonic()
                box.socket.sendall(f"{number}\n".encode())
                if not box.ready(ANSWER_S) or not box.socket.recv(64):
                    return KernelTrial(False, f"{named}: a box does not answer within {ANSWER_S:g} s")
                times_s.append(time.monotonic() - asked_s)
    except (InputError, WorldError) as error:
        return KernelTrial(False, f"{named}: {error}")
    trip_s = statistics.median(times_s)
    measured = f"{named}: start {start_ms:.0f} ms, round trip {1000 * trip_s:.2f} ms"
    if trip_s > ROUND_TRIP_S:
        return KernelTrial(False, f"{measured}, which is too slow: expected at most {1000 * ROUND_TRIP_S:g} ms")
    return KernelTrial(True, measured)


def choose_backend(wanted: str = AUTO) -> str:
    """Return the backend itself, or for `auto` the one that boxes have on this machine."""
    if wanted != AUTO:
        return wanted
    return OWN_KERNEL if try_own_kernel().succeeded else SHARED_KERNEL


def check_shared_kernel(backend: str, *, may_share: bool, setting: str) -> None:
    """Raise InputError if boxes of hidden phases would share a kernel without a permission.

    backend: a real one, see `choose_backend`. setting: how the user permits it.
    """
    if backend == OWN_KERNEL or may_share:
        return
    assert backend in BACKENDS
    trial = try_own_kernel()
    why = "the backend bubblewrap is set" if trial.succeeded else f"there is no kernel for each box: {trial.detail}"
    raise InputError(
        f"hidden phases: expected boxes with a kernel each, found boxes of {backend} ({why}), whose agents share the"
        " host's kernel and could carry what they see of hidden scenarios to other boxes (docs/sandbox-channels.md,"
        f" Residual channels); install gVisor, run hidden phases on another machine, or accept that with {setting}"
    )

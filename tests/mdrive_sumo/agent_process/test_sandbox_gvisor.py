"""What hostile programs come to in boxes of gVisor (`make test-all`); every slot is as before when they are done.

`relay` has its test in `test_sandbox_channels`, the layers theirs in `test_sandbox_layers`; both run in `make test`.
"""

import os
import platform
import shutil
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile.gvisor_verdicts import ANSWERED_INSIDE, GVISOR_VERDICTS
from hostile.verdicts import KILLED, VERDICTS
from testing.sandbox_runs import AGENTS, PATIENCE_S, SMALL, Ended, left_behind, needs_root, own_slot, python_spec, run

from mdrive_sumo.agent_process.sandbox import check_layers, gvisor, open_box
from mdrive_sumo.agent_process.sandbox.cgroups import find_hierarchy
from mdrive_sumo.agent_process.sandbox.gvisor import add_own_use

pytestmark = [
    pytest.mark.full,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("runsc") is None, reason="needs gVisor's runsc"),
]

SLOT = own_slot()


def run_inside(program: str, *arguments: str, stays: bool = False, **more: Any) -> Ended:
    return run(python_spec(program, *arguments, **{"slot": SLOT, "limits": SMALL, "backend": "gvisor", **more}), stays)


@pytest.fixture(autouse=True)
def _clean_slot() -> Iterator[None]:
    """The slot is as good as new afterwards: nothing runs in it, no group is left, a good program passes in it."""
    host = socket.gethostname()
    yield
    end = time.monotonic() + PATIENCE_S
    while left_behind(SLOT) and time.monotonic() < end:
        time.sleep(0.05)
    assert left_behind(SLOT) == []
    assert host == socket.gethostname()
    with open_box(python_spec("good", slot=SLOT, backend="gvisor")) as box:
        box.socket.sendall(np.arange(5.0).tobytes())
        assert box.ready(PATIENCE_S), box.log()
        assert np.frombuffer(box.socket.recv(64)).item() == 10.0


@pytest.mark.parametrize("name", GVISOR_VERDICTS)
def test_hostile_program_is_contained(name: str) -> None:
    expected = GVISOR_VERDICTS[name]
    if "cgroup" in expected.needs and find_hierarchy() is None:
        pytest.skip("needs control groups")
    ended = run_inside(name, stays=expected.stays, limits=expected.limits)
    report = ended.report
    assert {key: ended.told.get(key) for key in expected.told} == expected.told, ended
    assert all(0 < ended.told[key] <= most for key, most in expected.at_most.items()), ended
    assert report.exit_code == expected.exit_code, ended
    assert report.signal in expected.signals, ended
    assert report.oom_killed == expected.oom
    assert report.clean
    if report.peak_memory_bytes is not None:
        assert report.peak_memory_bytes <= add_own_use(expected.limits).memory_bytes


def test_calls_that_are_answered_are_answered_by_gvisors_kernel() -> None:
    if platform.machine() != "x86_64":
        pytest.skip("needs x86-64")
    ended = run_inside("kernel")
    assert ended.report.exit_code == 0, ended
    assert set(ended.told["open"]) <= ANSWERED_INSIDE, ended


def test_nothing_outside_is_reached_by_socket() -> None:
    """Sockets that can be made belong to gVisor's network, which has no way out; the services are really there."""
    with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_UNIX) as local:
        name = f"mdrive-test-{os.getpid()}"
        local.bind(f"\0{name}")
        local.listen()
        arguments = (str(tcp.getsockname()[1]), name)
        bare = run(python_spec("net", *arguments, backend="none"))
        assert {"tcp to the host", "abstract socket of the host"} <= set(bare.told["open"])
        inside = run_inside("net", *arguments)
    assert set(inside.told["open"]) <= {"udp", "netlink"}, inside


def test_no_file_of_the_host_is_reached(tmp_path: Path) -> None:
    needs_root()
    secret, folder = tmp_path / "hidden.scenario", tmp_path / "bound"
    secret.write_text("a hidden scenario")
    secret.chmod(0o644)
    folder.mkdir()
    for name, mode in (("closed", 0o600), ("open", 0o644)):
        (folder / name).write_text(name)
        (folder / name).chmod(mode)
    before = sorted(os.listdir("/dev"))  # noqa: PTH208
    ended = run_inside("files", str(secret), "/bound/closed", "/bound/open", readonly={folder: "/bound"})
    # Its /dev is its own, and so is its score for want of memory.
    assert set(ended.told["open"]) == {"read /bound/open", "write /dev/x", "less likely to be killed"}, ended
    assert ended.told["told_by_command_line"] == [] and set(ended.told["kinds"]) == {"0", "1", "2", "3"}
    assert str(tmp_path) not in ended.told["told_by_environment"]
    assert sorted(os.listdir("/dev")) == before  # noqa: PTH208


def test_a_set_uid_program_gains_nothing_outside(tmp_path: Path) -> None:
    """Inside, every program is user 0 of gVisor's kernel without capabilities; outside, all is the slot's user."""
    needs_root()
    tools = tmp_path / "tools"
    tools.mkdir()
    shutil.copy("/usr/bin/id", tools / "id")
    (tools / "id").chmod(0o4755)
    assert run_inside("setuid", readonly={tools: "/tools"}).told == {"user": "0"}
    assert "uid" in check_layers(("uid",), "gvisor")


@pytest.mark.skipif(find_hierarchy() is None, reason="needs control groups")
def test_a_program_that_computes_for_ever_is_ended_by_the_hosts_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Inside, the limit of CPU time is not kept. That it is the agent's failure is told by the CPU time used."""
    monkeypatch.setattr(gvisor, "CPU_GRACE_S", 1)
    with open_box(python_spec("spin", slot=SLOT, limits=replace(SMALL, cpu_s=1), backend="gvisor")) as box:
        assert box.ready(PATIENCE_S) and not box.socket.recv(1)
        while box.alive():
            time.sleep(0.01)
        report = box.close()
    assert report.signal == KILLED and report.clean
    assert report.cpu_s is not None and 1.0 <= report.cpu_s < 4.0


def test_a_flood_of_output_is_an_error_and_only_its_end_is_kept() -> None:
    """A full pipe is an error inside, not a wait; Python ends with 120 where it meets the error on its way out."""
    ended = run_inside("stdoutflood")
    assert ended.report.exit_code in (1, 120), ended
    assert len(ended.log) <= SMALL.log_bytes and ended.report.clean


def test_every_program_has_a_verdict() -> None:
    own = {"kernel", "net", "files", "setuid", "spin", "stdoutflood"}
    assert GVISOR_VERDICTS.keys() | own >= VERDICTS.keys()
    elsewhere = {"good", "tell", "relay", "diary", "impostor"}
    assert {path.stem for path in AGENTS.glob("*.py")} - elsewhere == GVISOR_VERDICTS.keys() | own

"""What hostile programs come to in a box; every slot is as before when they are done."""

import os
import platform
import shutil
import socket
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hostile.verdicts import VERDICTS
from testing.sandbox_runs import AGENTS, MEBIBYTE, PATIENCE_S, SMALL, left_behind, own_slot, python_spec, run

from mdrive_sumo.agent_process.sandbox import examine_layers, open_box
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID

pytestmark = pytest.mark.slow

SLOT = own_slot()


@cache
def here() -> frozenset[str]:
    return frozenset(layer.name for layer in examine_layers() if layer.active)


def need(*names: str) -> None:
    reasons = {"namespaces": "needs bubblewrap", "seccomp": "needs bubblewrap", "uid": "needs root"}
    missing = sorted({"namespaces", "seccomp", *names} - here())
    if missing:
        pytest.skip(reasons.get(missing[-1], "needs control groups"))


@pytest.fixture(autouse=True)
def _clean_slot(_good_slot: None) -> Iterator[None]:
    """The slot is empty afterwards: nothing runs in it, no group is left."""
    yield
    end = time.monotonic() + PATIENCE_S
    while left_behind(SLOT) and time.monotonic() < end:
        time.sleep(0.05)
    assert left_behind(SLOT) == []


@pytest.fixture(scope="module")
def _good_slot() -> Iterator[None]:
    """A good program passes in the slot when all are done; in between, the next program does as its verdict says."""
    need()
    yield
    with open_box(python_spec("selfexit", slot=SLOT, limits=SMALL)) as box:
        assert box.ready(PATIENCE_S)
        assert box.close().exit_code == 0


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if VERDICTS[name].slow else ()) for name in VERDICTS],
)
def test_hostile_program_is_contained(name: str) -> None:
    expected = VERDICTS[name]
    need(*expected.needs)
    if name == "kernel" and platform.machine() != "x86_64":
        pytest.skip("needs x86-64")
    ended = run(python_spec(name, slot=SLOT, limits=expected.limits), expected.stays)
    report = ended.report
    assert {key: ended.told.get(key) for key in expected.told} == expected.told, ended
    assert all(0 < ended.told[key] <= most for key, most in expected.at_most.items()), ended
    assert report.exit_code == expected.exit_code, ended
    assert report.signal in expected.signals, ended
    assert report.oom_killed == expected.oom
    assert report.clean
    if report.peak_memory_bytes is not None:
        assert report.peak_memory_bytes <= expected.limits.memory_bytes


def test_nothing_outside_is_reached_by_socket() -> None:
    """The services are really there: the same program, without a box, reaches them."""
    with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_UNIX) as local:
        name = f"mdrive-test-{os.getpid()}"
        local.bind(f"\0{name}")
        local.listen()
        arguments = (str(tcp.getsockname()[1]), name)
        bare = run(python_spec("net", *arguments, backend="none"))
        assert {"tcp to the host", "abstract socket of the host", "udp"} <= set(bare.told["open"])
        boxed = run(python_spec("net", *arguments, slot=SLOT, limits=SMALL))
    assert boxed.told == {"open": []}, boxed


def test_no_file_of_the_host_is_reached(tmp_path: Path) -> None:
    secret = tmp_path / "hidden.scenario"
    secret.write_text("a hidden scenario")
    secret.chmod(0o644)
    ended = run(python_spec("files", str(secret), slot=SLOT, limits=SMALL))
    assert ended.told == {
        "open": [],
        "told_of_itself": [],
        "told_by_command_line": [],
        "told_by_environment": "",
        "kinds": {"0": "device", "1": "pipe", "2": "pipe", "3": "socket"},
        "identities": [[0, 0]],
    }


def test_a_file_that_only_root_may_read_stays_closed_though_it_is_bound(tmp_path: Path) -> None:
    """bubblewrap started by root stays uid 0 for the kernel, whatever it is called inside."""
    need("uid")
    folder = tmp_path / "bound"
    folder.mkdir()
    for name, mode in (("closed", 0o600), ("open", 0o644)):
        (folder / name).write_text(name)
        (folder / name).chmod(mode)
    arguments = ("/bound/closed", "/bound/open")
    ended = run(python_spec("files", *arguments, slot=SLOT, limits=SMALL, readonly={folder: "/bound"}))
    assert ended.told["open"] == ["read /bound/open"]


def test_a_set_uid_program_gains_nothing(tmp_path: Path) -> None:
    need("uid")
    tools = tmp_path / "tools"
    tools.mkdir()
    shutil.copy("/usr/bin/id", tools / "id")
    (tools / "id").chmod(0o4755)
    ended = run(python_spec("setuid", slot=SLOT, limits=SMALL, readonly={tools: "/tools"}))
    assert ended.told == {"user": str(FIRST_UID + SLOT)}, ended


def test_a_flood_of_output_is_read_and_only_its_end_kept() -> None:
    ended = run(python_spec("stdoutflood", slot=SLOT, limits=SMALL))
    assert ended.report.log_bytes >= 40 * MEBIBYTE - 640
    assert len(ended.log) == SMALL.log_bytes
    assert ended.log.endswith(b"the end\n")


def test_a_flood_that_is_not_read_costs_nothing() -> None:
    with open_box(python_spec("stdoutflood", slot=SLOT, limits=SMALL)) as box:
        time.sleep(0.5)
        assert box.alive()
        began = time.monotonic()
        box.close()
    assert time.monotonic() - began < PATIENCE_S


def test_a_good_program_passes_in_every_slot_and_beside_others() -> None:
    need("uid")
    numbers = np.arange(5.0)
    with open_box(python_spec("good", slot=SLOT)) as first, open_box(python_spec("good", slot=SLOT + 1)) as second:
        for box in (first, second) * 3:
            box.socket.sendall(numbers.tobytes())
            assert box.ready(60.0), box.log()
            assert np.frombuffer(box.socket.recv(64)).item() == 10.0
        first.close()
        assert second.alive()
        assert second.close().signal == 9


def test_a_bomb_does_not_stop_its_neighbour() -> None:
    need("uid", "cgroup")
    with open_box(python_spec("good", slot=SLOT + 1)) as neighbour:
        run(python_spec("forkbomb", slot=SLOT, limits=SMALL), stays=True)
        run(python_spec("membomb", slot=SLOT, limits=SMALL))
        neighbour.socket.sendall(np.ones(3).tobytes())
        assert neighbour.ready(60.0)
        assert np.frombuffer(neighbour.socket.recv(64)).item() == 3.0


def test_the_pages_name_every_program_and_every_layer() -> None:
    folder = AGENTS.parents[2] / "docs"
    page = "".join((folder / name).read_text() for name in ("sandbox.md", "sandbox-hostile.md"))
    names = {path.stem for path in AGENTS.glob("*.py")} - {"tell"} | {layer.name for layer in examine_layers()}
    assert {name for name in names if f"`{name}`" not in page} == set()

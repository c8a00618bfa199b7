"""The layers around a box: each is there and does something, and what a plain user lacks is said."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pyseccomp
import pytest
from testing.group_members import call_in_small_interpreter
from testing.sandbox_runs import (
    SMALL,
    needs_bubblewrap,
    needs_root,
    own_slot,
    python_spec,
    shell_spec,
)

from mdrive_sumo.agent_process.sandbox import (
    BoxLimits,
    BoxSpec,
    cgroups,
    check_layers,
    examine_layers,
    layers,
    open_box,
    seccomp,
)
from mdrive_sumo.agent_process.sandbox.cgroups import remove_dead_episode_groups
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY
from mdrive_sumo.core.errors import InputError

SLOT = own_slot()
REACHABLE_PYTHON = shutil.which("python3", path="/usr/bin")
"""An interpreter that other users may run; this one may lie in a closed folder of root."""
PLAIN_USER = 54321 if os.geteuid() == 0 else None
"""User to change to; None: this process runs as such a user already."""


shell = partial(shell_spec, slot=SLOT)
pytestmark = needs_bubblewrap


def in_a_child(uid: int | None, action: Callable[[], object]) -> object:
    """What `action` returns in a process of another user, through JSON."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            if uid is not None:
                os.setgroups([])
                os.setresgid(uid, uid, uid)
                os.setresuid(uid, uid, uid)
                sys.executable = REACHABLE_PYTHON or sys.executable
            os.write(writing, json.dumps(action()).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        text = pipe.read()
    os.waitpid(pid, 0)
    return json.loads(text)


def test_clone3_is_answered_so_that_libraries_fall_back(tmp_path: Path) -> None:
    text = "import ctypes, os; l = ctypes.CDLL(None, use_errno=True); l.syscall(435, 0, 0); print(ctypes.get_errno())"
    spec = python_spec("selfexit", slot=SLOT)
    with open_box(BoxSpec((spec.command[0], "-c", text), spec.readonly, slot=SLOT)) as box:
        box.ready(60.0)
        box.close()
    assert box.log() == b"38\n"


def test_without_the_filter_nested_user_namespaces_are_still_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "unshare --user true && echo nested"

    class Nothing(pyseccomp.SyscallFilter):
        def add_rule(self, *_: object, **__: object) -> None:
            """Refuses nothing."""

    monkeypatch.setattr(pyseccomp, "SyscallFilter", Nothing)
    allow_all = seccomp.compile_filter.__wrapped__()
    monkeypatch.undo()
    assert len(allow_all) < len(seccomp.compile_filter())
    monkeypatch.setattr(seccomp, "compile_filter", lambda: allow_all)
    with open_box(shell(text)) as box:
        box.ready(30.0)
        box.close()
    assert b"nested" not in box.log()
    assert b"No space left" in box.log()


def test_every_refused_call_has_a_reason_and_is_named_once() -> None:
    calls = [call for refusal in seccomp.REFUSALS for call in refusal.calls]
    assert len(calls) == len(set(calls)) > 60
    assert all(len(refusal.reason) > 10 for refusal in seccomp.REFUSALS)


def test_limits_are_set_on_the_boxs_group_and_not_on_the_evaluators() -> None:
    """A limit on the parent would hold for all boxes together."""
    hierarchy = cgroups.find_hierarchy()
    if hierarchy is None or hierarchy.version != 1:
        pytest.skip("needs control groups")
    own = hierarchy.folders["memory"] / "memory.limit_in_bytes"
    before = own.read_text()
    with open_box(shell("echo here >&3; sleep 600", limits=SMALL)) as box:
        group = hierarchy.folders["memory"] / f"mdrive-box-{box.slot}"
        assert int((group / "memory.limit_in_bytes").read_text()) == SMALL.memory_bytes
        assert int((hierarchy.folders["pids"] / group.name / "pids.max").read_text()) == SMALL.processes
        assert own.read_text() == before
        assert box.socket.recv(10) == b"here\n"
        assert len((group / "cgroup.procs").read_text().split()) >= 2
    assert not group.exists()


def fake_version_2(folder: Path, controllers: str) -> Path:
    """As systemd delegates it: the evaluator's processes in a leaf, the controllers handed down beside it."""
    (folder / "mount" / "service" / "evaluator").mkdir(parents=True)
    (folder / "mount" / "service" / "cgroup.subtree_control").write_text(controllers)
    (folder / "mount" / "service" / "evaluator" / "cgroup.subtree_control").write_text("")
    (folder / "cgroup").write_text("0::/service/evaluator\n")
    mount = folder / "mount"
    (folder / "mountinfo").write_text(f"30 23 0:26 / {mount} rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n")
    return mount / "service"


def test_version_2_is_used_where_it_is_delegated(tmp_path: Path) -> None:
    service = fake_version_2(tmp_path, "cpu memory pids\n")
    hierarchy = cgroups.find_hierarchy(tmp_path)
    assert hierarchy is not None
    assert (hierarchy.version, set(hierarchy.folders.values())) == (2, {service})
    group = cgroups.Cgroup.make(hierarchy, "mdrive-box-0", BoxLimits())
    folder = service / "mdrive-box-0"
    assert {path.name: path.read_text() for path in folder.iterdir()} == {
        "memory.max": str(BoxLimits().memory_bytes),
        "pids.max": "64",
        "cpu.max": "100000 100000",
    }
    (folder / "memory.events").write_text("low 0\nmax 3\noom 1\noom_kill 1\n")
    (folder / "memory.peak").write_text("4096\n")
    (folder / "cpu.stat").write_text("usage_usec 1500000\nuser_usec 1\n")
    assert (group.oom_killed(), group.peak_memory_bytes(), group.cpu_s()) == (True, 4096, 1.5)

    assert group.reached_own_limit()
    (folder / "memory.events").write_text("low 0\nhigh 0\nmax 0\noom 0\noom_kill 1\n")
    assert group.oom_killed() and not group.reached_own_limit()


def test_an_episode_has_a_group_beside_those_of_its_boxes(tmp_path: Path) -> None:
    service = fake_version_2(tmp_path, "cpu memory pids\n")
    (service / f"{cgroups.EPISODE_PREFIX}7").mkdir()
    (tmp_path / "cgroup").write_text(f"0::/service/{cgroups.EPISODE_PREFIX}7\n")
    hierarchy = cgroups.find_hierarchy(tmp_path)
    assert hierarchy is not None and set(hierarchy.folders.values()) == {service}


def test_a_live_workers_group_stays_before_the_worker_joins_it(tmp_path: Path) -> None:
    service = fake_version_2(tmp_path, "cpu memory pids\n")
    ended = in_a_child(None, os.getpid)
    live, dead = (service / f"{cgroups.EPISODE_PREFIX}{pid}" for pid in (os.getpid(), ended))
    live.mkdir()
    dead.mkdir()
    (tmp_path / "cgroup").write_text(f"0::/service/{live.name}\n")
    remove_dead_episode_groups(cgroups.find_hierarchy(tmp_path))
    assert live.is_dir() and not dead.exists()


@pytest.mark.slow
def test_an_episodes_memory_is_limited_and_its_group_removed() -> None:
    hierarchy = cgroups.find_hierarchy()
    if hierarchy is None or hierarchy.version != 1:
        pytest.skip("needs control groups")

    found = call_in_small_interpreter("fill_episode_group", SLOT)
    assert isinstance(found, list)
    group = hierarchy.folders["memory"] / f"{cgroups.EPISODE_PREFIX}{found.pop()}"
    assert found == [True, True, True, signal.SIGKILL]
    assert group.is_dir()
    end = time.monotonic() + 30.0
    while group.exists() and time.monotonic() < end:  # the supervisor of its boxes ends a moment later
        remove_dead_episode_groups()
        time.sleep(0.01)
    assert not group.exists()


@pytest.mark.slow
def test_a_box_that_starves_by_the_limit_of_a_group_around_it_is_our_failure() -> None:
    hierarchy = cgroups.find_hierarchy()
    if hierarchy is None or hierarchy.version != 1:
        pytest.skip("needs control groups")
    outer = hierarchy.folders["memory"] / f"mdrive-test-{os.getpid()}"
    outer.mkdir()

    try:
        blamed = call_in_small_interpreter("starve_box", str(outer), SLOT)
        assert blamed == "sandbox: the kernel ended a process of the box for want of memory outside of it"
    finally:
        end = time.monotonic() + 30.0
        while (outer / "cgroup.procs").read_text() and time.monotonic() < end:  # the supervisor ends a moment later
            time.sleep(0.01)
        outer.rmdir()


def test_version_2_without_memory_is_not_taken_for_a_limit(tmp_path: Path) -> None:
    fake_version_2(tmp_path, "hugetlb\n")
    assert cgroups.find_hierarchy(tmp_path) is None


def test_a_plain_user_gets_a_box_and_is_told_what_it_lacks() -> None:
    seccomp.compile_filter()
    found = in_a_child(PLAIN_USER, lambda: {layer.name: (layer.active, layer.detail) for layer in examine_layers()})
    assert isinstance(found, dict)
    assert [
        name for name in ("namespaces", "read-only", "privileges", "seccomp", "rlimits") if not found[name][0]
    ] == []
    assert found["uid"] == [False, "all boxes run as the user who starts them; only root can change that"]
    assert found["cgroup"][0] is (PLAIN_USER is None and cgroups.find_hierarchy() is not None)
    assert found["cgroup"][0] or "for each process only" in found["cgroup"][1]


def test_a_plain_users_box_limits_the_memory_of_each_process() -> None:
    if PLAIN_USER is None and cgroups.find_hierarchy() is not None:
        pytest.skip("needs root")
    text = "ulimit -v; ulimit -n"

    def look() -> str:
        with open_box(shell(text, limits=SMALL)) as box:
            box.ready(30.0)
            box.close()
        return box.log().decode()

    assert in_a_child(PLAIN_USER, look) == f"{SMALL.memory_bytes // 1024}\n{SMALL.open_files}\n"


MASKED = """
mount -t proc proc /proc; mount --bind /proc/sys /proc/sys; mount -o remount,ro,bind /proc/sys
exec "$@"
"""
"""As a container's engine shows `/proc/sys`."""


@pytest.mark.slow
def test_a_box_that_ends_while_it_is_looked_at_is_no_box_and_a_sentence() -> None:
    """bubblewrap starts, and ends because it cannot forbid user namespaces."""
    needs_root()
    namespaces = ("unshare", "--mount", "--pid", "--fork", "--propagation", "private", "sh", "-ec", MASKED, "sh")
    doctor = (sys.executable, "-m", "mdrive_sumo", "doctor", "--sandbox")
    found = subprocess.run((*namespaces, *doctor), capture_output=True, text=True, check=False, timeout=60)
    assert (found.returncode, found.stderr) == (1, "")
    assert "cannot open /proc/sys/user/max_user_namespaces: Read-only file system" in found.stdout


def test_layers_are_looked_at_from_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without bubblewrap has none, and the sentence says why."""
    needs_root()
    expected = ("namespaces", "read-only", "privileges", "seccomp", "private-files", "proc", "uid", "rlimits")
    assert tuple(name for name in check_layers(expected) if name != "cgroup") == expected
    with pytest.raises(InputError, match=r"expected layers among namespaces, .*found walls"):
        check_layers(("namespaces", "walls"))
    monkeypatch.setenv("PATH", "/nowhere")
    assert [layer.name for layer in examine_layers() if layer.active] == ["rootfs"]
    with pytest.raises(InputError, match=r"found no seccomp .*needs the program bwrap, which is not installed here"):
        check_layers(("seccomp",))


@pytest.mark.slow
def test_layers_of_gvisor_are_those_of_its_own_box(monkeypatch: pytest.MonkeyPatch) -> None:
    needs_root()
    if shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    found = {layer.name: layer for layer in examine_layers("gvisor")}
    assert "gVisor's own kernel" in found["namespaces"].detail and "gVisor's own kernel" in found["seccomp"].detail
    needed = {"namespaces", "read-only", "privileges", "seccomp", "uid", "rlimits", "own-kernel"}
    assert needed <= set(check_layers((), "gvisor"))
    assert "when files were last read" not in found["private-files"].detail
    monkeypatch.setattr(layers, "may_mount", lambda: False)
    assert (
        "a later box in a slot sees when files were last read" in layers._examine_files({}, "gvisor", MEMORY, "").detail
    )
    assert not layers._has_own_kernel({"kernel": Path("/proc/version").read_text().strip()}, "gvisor")


def test_a_box_that_is_out_of_memory_ends_alike_under_both_versions() -> None:
    """Version 1 kills the process that asks for too much; version 2 must not be told to kill the whole box."""
    files = {file for _, file, _ in cgroups._limit_settings(2, BoxLimits())}
    assert files == {"memory.max", "memory.swap.max", "pids.max", "cpu.max"}

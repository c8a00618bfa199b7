"""A box: what it is given, what it reports and how it ends."""

import os
import shutil
import signal
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from testing.paths import ROOT
from testing.sandbox_runs import (
    PATIENCE_S,
    SMALL,
    left_behind,
    needs_bubblewrap,
    needs_root,
    own_slot,
    processes_of,
    python_spec,
    reachable,
    shell_spec,
)

from mdrive_sumo.agent_process.sandbox import BoxError, BoxLimits, BoxSpec, cgroups, open_box
from mdrive_sumo.agent_process.sandbox import box as box_module
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from mdrive_sumo.core.errors import InputError

SLOT = own_slot()


shell = partial(shell_spec, slot=SLOT)
pytestmark = [pytest.mark.slow, needs_bubblewrap]


def test_box_speaks_both_ways_and_tells_its_own_exit_code() -> None:
    with open_box(shell("read word <&3; echo got $word >&3; echo printed; echo aside >&2; exit 7")) as box:
        box.socket.sendall(b"hello\n")
        assert box.ready(PATIENCE_S)
        assert box.socket.recv(100) == b"got hello\n"
        assert box.socket.recv(100) == b""
        report = box.close()
    assert (report.exit_code, report.signal, report.oom_killed, report.clean) == (7, None, False, True)
    assert box.log() == b"printed\naside\n"
    assert report.log_bytes == len(box.log())
    assert not box.alive()
    assert box.close() is report


def test_a_signal_is_told_as_one() -> None:
    with open_box(shell("kill -SEGV $$")) as box:
        box.ready(PATIENCE_S)
        assert (box.close().exit_code, box.close().signal) == (None, signal.SIGSEGV)


def test_a_living_box_is_killed_by_close() -> None:
    with open_box(shell("trap '' TERM INT HUP; while :; do sleep 1; done")) as box:
        assert box.alive()
        assert not box.ready(0.1)
        report = box.close()
    assert report.signal == signal.SIGKILL
    assert report.clean


def test_a_program_that_has_shut_down_its_side_may_end_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """As gVisor's do: it still holds the socket for them when they are gone."""
    monkeypatch.setitem(box_module.GOING_S, "bubblewrap", PATIENCE_S)
    text = "import socket, sys, time; s = socket.socket(fileno=3); s.shutdown(1); time.sleep(0.5); sys.exit(5)"
    spec = python_spec("selfexit", slot=SLOT)
    with open_box(BoxSpec((spec.command[0], "-c", text), spec.readonly, slot=SLOT)) as box:
        assert box.ready(PATIENCE_S)
        assert box.socket.recv(1) == b""
        assert box.close().exit_code == 5


def test_a_program_that_hangs_up_but_stays_does_not_hold_up_its_end() -> None:
    with open_box(shell("exec 3>&-; sleep 600")) as box:
        assert box.ready(PATIENCE_S)
        assert box.socket.recv(1) == b""
        assert box.close().signal == signal.SIGKILL


def test_the_box_begins_beside_the_agents_files_with_nothing_of_our_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SECRET", "token")
    tmp_path.chmod(0o755)
    with open_box(shell("pwd; hostname; env", readonly={tmp_path: "/agent"}, env={"MODE": "a b\nc"})) as box:
        box.ready(PATIENCE_S)
        box.close()
    lines = box.log().decode().splitlines()
    assert lines[:2] == ["/agent", "agent"]
    assert {"MODE=a b", "OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1"} <= set(lines)
    assert "SECRET" not in box.log().decode()


def test_paths_in_closed_folders_of_root_can_be_shown(tmp_path: Path) -> None:
    """The user of the box could not reach them outside: they are bound before the rights are dropped."""
    needs_root()
    closed = tmp_path / "closed"
    (closed / "agent").mkdir(parents=True)
    (closed / "agent" / "words").write_text("here")
    closed.chmod(0o700)
    with open_box(shell("cat words; ls ..", readonly={closed / "agent": "/agent"})) as box:
        box.ready(PATIENCE_S)
        assert box.close().exit_code == 0
    assert box.log().startswith(b"here")


def test_each_slot_has_a_user_of_its_own_and_one_box_at_a_time() -> None:
    needs_root()
    with open_box(shell("id -u; sleep 600")) as box:
        with pytest.raises(InputError, match=f"slot {SLOT} to be free on this host"):
            open_box(shell("true"))
        with open_box(shell("id -u", slot=None)) as other:
            other.ready(PATIENCE_S)
            other.close()
        assert other.slot != SLOT
        assert int(other.log()) == FIRST_UID + other.slot
        while not box.log():
            time.sleep(0.01)
        assert int(box.log()) == FIRST_UID + SLOT
    with open_box(shell("true")) as again:
        assert again.slot == SLOT


def test_a_slot_that_could_not_be_cleaned_stays_taken_and_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    if cgroups.find_hierarchy() is None:
        pytest.skip("needs control groups")
    removed = cgroups.Cgroup.remove

    def refuses(group: cgroups.Cgroup, wait_s: float) -> bool:
        removed(group, wait_s)
        return False

    with open_box(shell("sleep 600", slot=SLOT + 1)) as box:
        monkeypatch.setattr(cgroups.Cgroup, "remove", refuses)
        report = box.close()
    monkeypatch.undo()
    assert not report.clean
    with pytest.raises(InputError, match="to be free"):
        open_box(shell("true", slot=SLOT + 1))


def test_a_box_is_opened_in_the_main_thread_only() -> None:
    """`--die-with-parent` follows the thread: a box of a pool's thread dies when that thread is let go."""
    told: list[str] = []

    def attempt() -> None:
        try:
            open_box(shell("true"))
        except RuntimeError as error:
            told.append(str(error))

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    assert told == ["a box ends with the thread that opens it: open it in the main thread of its process"]


@pytest.mark.parametrize("backend", ["bubblewrap", "gvisor"])
def test_a_box_never_outlives_its_owner(backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs_root()
    if backend == "gvisor" and shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    monkeypatch.setattr(tempfile, "tempdir", str(reachable(tmp_path)))  # a dead owner removes nothing
    reading, writing = os.pipe()
    owner = os.fork()
    if owner == 0:
        try:
            box = open_box(python_spec("forkbomb", slot=SLOT, limits=SMALL, backend=backend))
            box.ready(60.0)
            os.write(writing, b"open")
            time.sleep(600)
        finally:
            os._exit(1)
    os.close(writing)
    assert os.read(reading, 4) == b"open"
    os.close(reading)
    assert len(processes_of(FIRST_UID + SLOT)) > 3
    os.kill(owner, signal.SIGKILL)
    os.waitpid(owner, 0)
    end = time.monotonic() + PATIENCE_S
    while processes_of(FIRST_UID + SLOT) and time.monotonic() < end:
        time.sleep(0.02)
    assert processes_of(FIRST_UID + SLOT) == []
    with open_box(shell("true", backend=backend)) as box:  # what the dead owner left is cleared away
        box.ready(PATIENCE_S)
        assert box.close().exit_code == 0
    assert left_behind(SLOT) == []
    assert list(tmp_path.glob("mdrive-box-*")) == []


def test_bubblewraps_own_failure_is_ours_and_not_the_agents(tmp_path: Path) -> None:
    """Its exit code 1 would else pass for the agent's."""
    file = tmp_path / "file"
    file.write_text("")
    box = open_box(shell("true", readonly={file: "/agent", tmp_path: "/agent/below"}))
    with pytest.raises(BoxError, match="bubblewrap failed: bwrap: Can't mkdir parents for /agent/below"):
        while True:
            box.ready(1.0)
            box.close()
    assert left_behind(SLOT) == []
    with open_box(shell("exit 1")) as box:
        box.ready(PATIENCE_S)
        assert box.close().exit_code == 1


def test_a_box_that_is_killed_from_outside_is_not_the_agents_failure() -> None:
    with open_box(shell("echo here >&3; sleep 600")) as box:
        assert box.socket.recv(10) == b"here\n"
        os.kill(box.pid, signal.SIGKILL)
        while box.alive():
            time.sleep(0.01)
        with pytest.raises(BoxError, match="ended by signal 9 from outside"):
            box.close()


def test_a_program_that_is_not_there_is_told() -> None:
    box = open_box(BoxSpec(("/no/such",), {}, slot=SLOT))
    box.ready(PATIENCE_S)
    with pytest.raises(BoxError, match="/no/such"):
        box.close()


BAD = (
    ({"backend": "docker"}, "expected the backend bubblewrap, gvisor, none, found 'docker'"),
    ({"slot": 1000}, "expected a slot from 0 to 999, found 1000"),
    ({"command": ()}, "expected a command to run, found none"),
    ({"command": ("/bin/sh", "a\0b")}, "expected words without NUL"),
    ({"env": {"A=B": "c"}}, "names without '='"),
    ({"readonly": {ROOT: "agent"}}, "expected an absolute path inside the box for .*, found 'agent'"),
    ({"readonly": {ROOT: "/agent/../etc"}}, "expected an absolute path"),
    ({"readonly": {ROOT: "/usr/agent"}}, "/usr/agent is not free inside the box"),
    ({"readonly": {ROOT / "no-such-folder": "/agent"}}, "to be seen as /agent, does not exist"),
    ({"rootfs": ROOT}, "expected an unpacked image with a folder usr"),
)


@pytest.mark.parametrize(("wrong", "sentence"), BAD, ids=lambda value: str(value)[:40])
def test_what_cannot_be_is_refused_with_a_sentence(wrong: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        BoxSpec(**{"command": ("/bin/sh",), "readonly": {}, **wrong})


def test_limits_are_positive_integers() -> None:
    with pytest.raises(InputError, match="limits of the sandbox, processes: expected a positive integer, found 0"):
        BoxLimits(processes=0)


def test_opening_leaves_no_descriptors_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def count() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    with open_box(shell("true")):
        pass
    before = count()
    with open_box(shell("true")) as box:
        box.ready(PATIENCE_S)
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError):
        open_box(shell("true"))
    assert count() == before

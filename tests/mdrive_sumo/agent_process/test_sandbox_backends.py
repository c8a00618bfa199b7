"""Other backends, and other programs than the host's."""

import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

import pytest
from testing.paths import ROOT
from testing.sandbox_runs import left_behind, needs_bubblewrap, own_slot, python_spec, reachable, run, shell_spec

from mdrive_sumo.agent_process.sandbox import BoxError, BoxSpec, open_box
from mdrive_sumo.core.errors import InputError

SLOT = own_slot()


shell = partial(shell_spec, slot=SLOT)
pytestmark = needs_bubblewrap


def test_a_weaker_box_is_never_taken_silently(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    for backend, program in (("bubblewrap", "bwrap"), ("gvisor", "runsc")):
        with pytest.raises(InputError, match=f"the backend {backend} needs the program {program}"):
            open_box(shell("true", backend=backend))


def tiny_image(folder: Path) -> Path:
    """A shell, its libraries, and a file that says where one is."""
    for program in ("/usr/bin/dash", "/usr/bin/cat"):
        listed = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout.split()
        for path in (program, *(word for word in listed if word.startswith("/"))):
            place = folder / "usr" / path.removeprefix("/usr").lstrip("/")
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
    for name in ("bin", "lib", "lib64"):
        (folder / name).symlink_to(f"usr/{name}")
    (folder / "etc").mkdir()
    (folder / "etc" / "os-release").write_text("tiny image")
    return folder


def test_the_programs_may_come_from_an_image(tmp_path: Path) -> None:
    if not Path("/usr/bin/dash").exists():
        pytest.skip("needs dash")
    image = tiny_image(tmp_path)
    (image / "opt").mkdir()
    spec = BoxSpec(("/bin/dash", "-c", "cat /etc/os-release; echo /usr/bin/*"), {ROOT: "/opt"}, slot=SLOT, rootfs=image)
    with open_box(spec) as box:
        box.ready(30.0)
        assert box.close().exit_code == 0
    assert box.log() == b"tiny image/usr/bin/cat /usr/bin/dash\n"


@pytest.mark.slow
def test_gvisor_passes_the_socket_and_shows_a_kernel_of_its_own() -> None:
    if shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    ended = run(python_spec("procs", slot=SLOT, backend="gvisor"))
    assert ended.told["groups"] == []
    script = "read word <&3; echo $word >&3; uname -r; echo away >/dev/null && exit 5"
    with open_box(shell(script, backend="gvisor")) as box:
        box.socket.sendall(b"hello\n")
        assert box.ready(60.0)
        assert box.socket.recv(100) == b"hello\n"
        assert box.ready(60.0)
        assert box.socket.recv(100) == b""
        report = box.close()
    assert box.log().strip() != os.uname().release.encode()
    assert (report.exit_code, report.clean) == (5, True)
    assert left_behind(SLOT) == []


@pytest.mark.slow
def test_gvisors_output_has_room_until_it_is_read() -> None:
    """A write to a full pipe is an error there, which an honest program that prints much at once must not meet."""
    if shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    with open_box(shell("head -c 900000 /dev/zero && echo done >&3; exit 5", backend="gvisor")) as box:
        assert os.read(box.socket.fileno(), 10) == b"done\n"  # nothing has read its output so far
        while box.alive():
            box.pump()
        report = box.close()
    assert (report.exit_code, report.log_bytes) == (5, 900000)


def test_gvisors_own_failure_is_ours_and_not_the_agents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "runsc"
    broken.write_text("#!/bin/sh\necho no platform >&2\nexit 128\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{reachable(tmp_path)}:{os.environ['PATH']}")
    with pytest.raises(BoxError, match="gVisor did not start: no platform"):
        open_box(shell("true", backend="gvisor"))
    assert left_behind(SLOT) == []


def test_without_a_box_the_same_program_runs_with_outer_paths(tmp_path: Path) -> None:
    (tmp_path / "words").write_text("outer")
    spec = shell("cat words $PLACE; pwd", readonly={tmp_path: "/agent"}, env={"PLACE": "/agent/words"}, backend="none")
    with open_box(spec) as box:
        box.ready(30.0)
        assert box.close().exit_code == 0
    assert box.log().decode() == f"outerouter{tmp_path}\n"

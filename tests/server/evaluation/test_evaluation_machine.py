"""Whether this machine may evaluate, and what starts the workers on it."""

import errno
import json
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from testing import databases, evaluation_fakes, processes

from mdrive_sumo.agent_process import sandbox
from mdrive_sumo.agent_process.sandbox import kernel_trial
from mdrive_sumo.core.errors import InputError
from server.environments import ABOUT_FILE
from server.evaluation.machine_check import check_hidden_phases, check_machine
from server.evaluation.supervisor import Supervisor
from server.settings import WARM_UP, PhaseSettings, SandboxSettings, ServerSettings, WorkerSettings, load_settings
from server.store import phases as store_phases


@pytest.mark.parametrize("backend", ["none", "gvsior"])
def test_no_server_drives_foreign_code_without_a_box(backend: str) -> None:
    with pytest.raises(InputError, match=r"sandbox\.backend: .*'auto', 'bubblewrap' or 'gvisor'"):
        load_settings(None, {"MDRIVE_SANDBOX__BACKEND": backend})


def test_a_machine_is_asked_for_boxes_of_the_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match=r"found no seccomp .*the backend gvisor needs the program runsc"):
        check_machine(ServerSettings(sandbox=SandboxSettings(backend="gvisor", required=("seccomp",))))


def hidden(suite: str, **changed: Any) -> PhaseSettings:
    """A phase of this suite."""
    return WARM_UP.model_copy(update={"id": "test", "suite": suite, "public": False} | changed)


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"data": Path("/usr/src/app/data")}, "data: "),
        ({"data": Path("/lib/mdrive")}, "data: "),  # a link to /usr/lib
        ({"database": "sqlite:////usr/share/challenge.sqlite"}, "database: "),
        ({"phases": (hidden("/usr/src/app/suite"),)}, "phase test: suite: "),
        ({"work": WorkerSettings(scheduler="tcp://127.0.0.1:1"), "data": Path("/usr/src/app/data")}, "data: "),
    ],
)
def test_what_is_secret_lies_where_no_box_looks(tmp_path: Path, changed: dict[str, Any], what: str) -> None:
    found = ServerSettings(data=tmp_path, sandbox=evaluation_fakes.SHARED).model_copy(update=changed)
    with pytest.raises(
        InputError, match=rf"^{what}expected a folder that no sandbox sees, .*every agent can read /usr"
    ):
        check_machine(found)


def test_a_link_in_an_image_shows_nothing_of_the_host(tmp_path: Path) -> None:
    """It is made anew in the box, and leads into the image there."""
    (tmp_path / "image" / "usr").mkdir(parents=True)
    (tmp_path / "image" / "srv").symlink_to(tmp_path)
    assert sandbox.list_shown_paths(tmp_path / "image") == {tmp_path / "image" / "usr"}


def test_what_is_public_may_lie_anywhere_and_an_image_is_seen_too(tmp_path: Path) -> None:
    shown = (hidden("/usr/src/app/suite", public=True, id="open"), hidden("interdrive"))
    found = ServerSettings(data=tmp_path / "image" / "srv" / "data", sandbox=evaluation_fakes.SHARED, phases=shown)
    check_machine(found)
    (tmp_path / "image" / "usr").mkdir(parents=True)
    about = found.environments / "python3.11-numpy" / ABOUT_FILE
    about.parent.mkdir(parents=True)
    image = {"python": "/opt/agent/bin/python", "rootfs": str(tmp_path / "image"), "packages": []}
    about.write_text(json.dumps(image))
    with pytest.raises(InputError, match=r"^data: expected a folder that no sandbox sees, .*image/srv$"):
        check_machine(found)


def test_a_service_does_not_start_with_what_is_no_address(tmp_path: Path) -> None:
    found = evaluation_fakes.settings(tmp_path)
    found = found.model_copy(update={"work": found.work.model_copy(update={"scheduler": "here"})})
    with pytest.raises(InputError, match=r"^--scheduler: expected tcp://HOST:PORT of a Dask scheduler, found 'here'"):
        Supervisor(databases.emptied("sqlite"), found).start()


@pytest.mark.slow
def test_a_worker_that_cannot_be_started_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    refusals = [OSError(errno.EAGAIN, "Resource temporarily unavailable"), OSError(errno.ENOMEM, "no memory")]
    popen = subprocess.Popen

    def sometimes(*args: Any, **options: Any) -> Any:
        if refusals:
            raise refusals.pop()
        return popen(*args, **options)

    monkeypatch.setattr(subprocess, "Popen", sometimes)
    monkeypatch.setattr("server.evaluation.supervisor.MAX_PAUSE_S", 0.01)
    monkeypatch.setattr("server.evaluation.supervisor.check_machine", lambda _: None)
    command = (sys.executable, "-c", "import sys; sys.stdin.read()")
    service = Supervisor(databases.emptied("sqlite"), evaluation_fakes.settings(tmp_path, processes=1), command)
    service.start()
    try:
        processes.wait_for(lambda: len(service.pids) == 1, limit_s=120.0)
    finally:
        service.stop()
    assert caplog.text.count("a worker cannot be started") == 2


def test_a_machine_that_lacks_a_layer_is_told_and_what_to_do() -> None:
    with pytest.raises(InputError, match=r"expected layers among .*found walls\. .*MDRIVE_SANDBOX__REQUIRED="):
        check_machine(ServerSettings(sandbox=SandboxSettings(backend="bubblewrap", required=("walls",))))


def refusing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a kernel for each box."""
    trial = kernel_trial.KernelTrial(False, "runsc (gVisor) is not installed")
    monkeypatch.setattr(kernel_trial, "try_own_kernel", lambda: trial)


SENTENCE = (
    r"^hidden phases: expected boxes with a kernel each, found boxes of bubblewrap \(there is no kernel for each box:"
    r" runsc \(gVisor\) is not installed\), whose agents share the host's kernel and could .*, or accept that with"
    r" \[sandbox\] hidden_on_shared_kernel = true$"
)


@pytest.mark.parametrize(
    ("backend", "changed", "is_refused"),
    [
        ("auto", {}, True),
        ("bubblewrap", {}, True),
        ("gvisor", {}, False),
        ("auto", {"hidden_on_shared_kernel": True}, False),
        ("auto", {"phase_kinds": "public"}, False),
        ("auto", {"scheduler": "tcp://127.0.0.1:1"}, False),
        ("auto", {"public": True}, False),
        ("auto", {"over": True}, False),
    ],
)
def test_hidden_phases_are_refused_where_boxes_share_a_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: Any, changed: dict[str, Any], is_refused: bool
) -> None:
    refusing(monkeypatch)
    store = databases.emptied("sqlite")
    phase = hidden("interdrive", public=changed.get("public", False))
    with store.write() as session:
        store_phases.set_phases(session, [phase.as_new()], 0)
    permitted = changed.get("hidden_on_shared_kernel", False)
    boxes = SandboxSettings(backend=backend, hidden_on_shared_kernel=permitted, required=())
    work = WorkerSettings(**{name: changed[name] for name in ("phase_kinds", "scheduler") if name in changed})
    settings = ServerSettings(data=tmp_path, sandbox=boxes, work=work)
    now_us = phase.as_new().closes_us + (1 if "over" in changed else -1)
    with store.read() as session, pytest.raises(InputError, match=SENTENCE) if is_refused else nullcontext():
        check_hidden_phases(settings, session, now_us)


def test_serve_does_not_start_with_a_hidden_phase_on_a_shared_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing(monkeypatch)
    store = databases.emptied("sqlite")
    with store.write() as session:
        store_phases.set_phases(session, [hidden("interdrive").as_new()], 0)
    found = evaluation_fakes.settings(tmp_path)
    boxes = found.sandbox.model_copy(update={"backend": "auto", "hidden_on_shared_kernel": False})
    with pytest.raises(InputError, match=SENTENCE):
        Supervisor(store, found.model_copy(update={"sandbox": boxes})).start()

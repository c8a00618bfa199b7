"""Which backend boxes have: found by a trial, whose command line is looked at with programs in place of `runsc`."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from testing.sandbox_runs import needs_bubblewrap, reachable

from mdrive_sumo.agent_process.sandbox import check_shared_kernel, choose_backend, gvisor, try_own_kernel
from mdrive_sumo.agent_process.sandbox.kernel_trial import KernelTrial
from mdrive_sumo.core.errors import InputError

MODULE = "mdrive_sumo.agent_process.sandbox.kernel_trial"
SETTING = "[sandbox] hidden_on_shared_kernel = true"
OLD_FLAGS = "specifies which platform to use: ptrace (default), kvm."
NEW_FLAGS = "specifies which platform to use: systrap (default), ptrace, kvm."
"""As `runsc flags` says it: release 20221219, and what the releases since 2023 document."""

Stub = Callable[[str], str]


@pytest.fixture(autouse=True)
def untried() -> Iterator[None]:
    """No answer of another test, and none left to one."""
    from mdrive_sumo.agent_process.sandbox.kernel_trial import _try

    for cached in (_try, gvisor.find_platform):
        cached.cache_clear()
    yield
    for cached in (_try, gvisor.find_platform):
        cached.cache_clear()


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Stub:
    """Puts a shell script in place of `runsc`; returns its path."""

    def make(script: str) -> str:
        program = reachable(tmp_path) / "runsc"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
        return str(program)

    return make


@pytest.mark.parametrize(
    ("script", "platform"),
    [
        (f"echo '{OLD_FLAGS}'", "ptrace"),
        (f"echo '{NEW_FLAGS}'", "systrap"),
        (f"echo '{NEW_FLAGS}' >&2; exit 2", "systrap"),
        ("exit 1", "ptrace"),
    ],
)
def test_systrap_is_taken_where_runsc_offers_it(stub: Stub, tmp_path: Path, script: str, platform: str) -> None:
    words = gvisor.make_command(stub(script), tmp_path / "box")
    assert f"--platform={platform}" in words and "--rootless" in words and "--network=none" in words


def test_a_runsc_that_says_nothing_about_its_flags_is_not_waited_for(
    stub: Stub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gvisor, "FLAGS_S", 0.1)
    assert gvisor.find_platform(stub("exec sleep 20")) == "ptrace"


def test_without_runsc_boxes_share_the_hosts_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert try_own_kernel() == KernelTrial(False, "runsc (gVisor) is not installed")
    assert choose_backend() == "bubblewrap"


def test_a_backend_that_is_named_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{MODULE}.try_own_kernel", lambda: pytest.fail("tried"))
    assert [choose_backend(name) for name in ("bubblewrap", "gvisor", "none")] == ["bubblewrap", "gvisor", "none"]


@needs_bubblewrap
@pytest.mark.parametrize(
    ("script", "detail"),
    [
        (f"[ $1 = flags ] && echo '{NEW_FLAGS}' && exit; echo no such platform >&2; exit 128", "no such platform"),
        ("[ $1 = flags ] && exit; exec sleep 20", "not within 0.6 s"),
        ("[ $1 = flags ] && exit; printf . >&0; exec sleep 20", "does not answer within 0.6 s"),
        (
            '[ $1 = flags ] && exit; printf . >&0; while read -r word <&0; do sleep 0.02; echo "$word" >&0; done',
            "which is too slow: expected at most 5 ms",
        ),
    ],
)
def test_a_runsc_that_does_not_work_or_is_slow_is_not_taken(
    stub: Stub, monkeypatch: pytest.MonkeyPatch, script: str, detail: str
) -> None:
    for name in ("START_S", "ANSWER_S"):
        monkeypatch.setattr(f"{MODULE}.{name}", 0.6)  # ample for a busy machine
    monkeypatch.setattr(f"{MODULE}.ROUND_TRIPS", 5)
    program = stub(script)
    trial = try_own_kernel()
    assert not trial.succeeded and detail in trial.detail, trial
    assert trial.detail.startswith(f"{program}, platform {'systrap' if 'systrap' in script else 'ptrace'}")
    assert choose_backend() == "bubblewrap"


@needs_bubblewrap
def test_the_answer_is_kept(stub: Stub, tmp_path: Path) -> None:
    stub(f"[ $1 = flags ] && exit; echo >>{tmp_path}/tries; exit 128")
    (tmp_path / "tries").touch(mode=0o666)
    (tmp_path / "tries").chmod(0o666)
    assert try_own_kernel() == try_own_kernel()
    assert len((tmp_path / "tries").read_text()) == 1


@pytest.mark.slow
def test_the_gvisor_of_this_machine_gives_each_box_a_kernel() -> None:
    if shutil.which("runsc") is None:
        pytest.skip("needs gVisor's runsc")
    trial = try_own_kernel()
    assert trial.succeeded, trial
    assert " start " in trial.detail and " round trip " in trial.detail
    assert choose_backend() == "gvisor"


def test_hidden_phases_need_a_kernel_each_or_a_permission(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{MODULE}.try_own_kernel", lambda: KernelTrial(False, "no runsc"))
    check_shared_kernel("gvisor", may_share=False, setting=SETTING)
    check_shared_kernel("bubblewrap", may_share=True, setting=SETTING)
    with pytest.raises(InputError) as caught:
        check_shared_kernel("bubblewrap", may_share=False, setting=SETTING)
    sentence = str(caught.value)
    assert "\n" not in sentence and SETTING in sentence and "no runsc" in sentence and "hidden scenarios" in sentence
    monkeypatch.setattr(f"{MODULE}.try_own_kernel", lambda: KernelTrial(True, "works"))
    with pytest.raises(InputError, match="the backend bubblewrap is set"):
        check_shared_kernel("bubblewrap", may_share=False, setting=SETTING)

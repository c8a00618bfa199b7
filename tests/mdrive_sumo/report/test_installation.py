"""What `doctor` finds and says."""

import sys

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.agent_process.sandbox import KernelTrial, SandboxLayer
from mdrive_sumo.cli import doctor as cli_doctor
from mdrive_sumo.cli.doctor import NEEDED_LAYERS, command
from mdrive_sumo.report import installation


@pytest.fixture(scope="module")
def checks() -> dict[str, installation.InstallationCheck]:
    """Of an environment that is not activated: the installed script is called as `.venv/bin/mdrive-sumo`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", "/nowhere")
        return {check.name: check for check in installation.examine_installation()}


@pytest.fixture
def sound_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests that are about something else."""
    monkeypatch.setattr(installation, "SIMULATOR_CHECK", "pass")


@pytest.mark.slow
def test_the_test_environment_lacks_nothing_that_the_core_needs(
    checks: dict[str, installation.InstallationCheck],
) -> None:
    assert [name for name, check in checks.items() if check.is_required and not check.is_found] == []
    assert checks["libsumo"].found == "1.28.0"
    assert checks["cores"].found == str(installation.count_usable_cores())


@pytest.mark.usefixtures("sound_simulator")
@pytest.mark.slow
def test_what_is_missing_is_named_with_its_command_and_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "PACKAGES", (("no-such-package", "convert", "convert"),))
    table = installation.format_installation_table(installation.examine_installation())
    assert "missing for convert: no-such-package (pip install '.[convert]')" in table


def test_a_system_without_posix_is_told_what_works_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "WSL2" not in installation._describe_platform()
    monkeypatch.setattr(installation, "is_posix", lambda: False)
    assert installation._describe_platform().endswith(
        ": built-in agents with one worker; all else needs Linux; on Windows use WSL2"
    )


@pytest.mark.slow
def test_a_broken_simulator_is_found_without_breaking_the_doctor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "SIMULATOR_CHECK", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    result = CliRunner().invoke(command)
    assert result.exit_code == 1
    assert "missing for eval, verify: libsumo (exit code -11; on Debian" in result.output


@pytest.mark.usefixtures("sound_simulator")
@pytest.mark.slow
def test_a_missing_extra_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "PACKAGES", (("no-such-package", "convert", "convert"),))
    assert CliRunner().invoke(command).exit_code == 0


@pytest.mark.slow
@pytest.mark.usefixtures("sound_simulator")
def test_a_missing_renderer_is_named_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLCONTEXT_DEVICE_INDEX", "nine")
    result = CliRunner().invoke(command)
    assert result.exit_code == 0, result.output
    sentence = "GLCONTEXT_DEVICE_INDEX: expected the number of an EGL device, found 'nine'; pip install"
    assert "missing for agents with cameras, render --view chase or driver: OpenGL (camera: " in result.output
    assert sentence in result.output


@pytest.mark.slow
def test_netconvert_is_found_beside_the_interpreter(checks: dict[str, installation.InstallationCheck]) -> None:
    found = checks["netconvert"].found
    if not found:
        pytest.skip("needs netconvert")
    assert found.startswith(sys.prefix)


def of_sandbox(monkeypatch: pytest.MonkeyPatch, *absent: str) -> Result:
    names = (*NEEDED_LAYERS, "uid", "cgroup", "own-kernel")
    found = tuple(SandboxLayer(name, name not in absent, f"how {name}") for name in names)
    has_kernel = "own-kernel" not in absent
    monkeypatch.setattr(cli_doctor, "examine_backend", lambda: ("gvisor" if has_kernel else "bubblewrap", found))
    monkeypatch.setattr(cli_doctor, "try_own_kernel", lambda: KernelTrial(has_kernel, "how it was tried"))
    return CliRunner().invoke(command, ["--sandbox"])


def test_a_machine_with_a_kernel_for_each_box_shows_what_the_fallback_leaves_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = of_sandbox(monkeypatch)
    assert result.exit_code == 0
    first, second, *_ = result.output.splitlines()
    assert first == "default backend: gvisor, a kernel for each box (how it was tried)"
    assert second == "fallback: bubblewrap"
    default, _, fallback = result.output.partition("The fallback bubblewrap would not protect from:\n")
    assert "The backend gvisor does not protect from:\n" in default and "numbers that the kernel counts" not in default
    assert "  - faults of the kernel" in fallback and "hidden_on_shared_kernel" not in result.output


def test_the_sandbox_is_shown_with_its_layers_and_its_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    result = of_sandbox(monkeypatch, "own-kernel", "cgroup", "uid")
    assert result.exit_code == 0
    assert "default backend: bubblewrap, the fallback, whose boxes share the host's kernel: how it was" in result.output
    assert "Hidden phases are refused here unless" in result.output and "hidden_on_shared_kernel = tr" in result.output
    assert "seccomp     in force  how seccomp\n" in result.output
    assert "cgroup      absent    how cgroup\n" in result.output
    assert "does not protect from:\n  - faults of the kernel" in result.output


@pytest.mark.parametrize("layer", NEEDED_LAYERS)
def test_without_a_layer_that_every_box_needs_there_is_no_sandbox(monkeypatch: pytest.MonkeyPatch, layer: str) -> None:
    assert of_sandbox(monkeypatch, layer).exit_code == 1

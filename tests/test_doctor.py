"""What `doctor` finds and says."""

import sys

import pytest
from click.testing import CliRunner

from mdrive_sumo import doctor
from mdrive_sumo.cli.doctor import command


def test_the_test_environment_lacks_nothing_that_the_core_needs() -> None:
    checks = {check.name: check for check in doctor.examine()}
    assert [name for name, check in checks.items() if check.required and not check.ok] == []
    assert checks["libsumo"].found == "1.28.0"
    assert checks["cores"].found == str(doctor.usable_cores())


def test_what_is_missing_is_named_with_its_command_and_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "PACKAGES", (("no-such-package", "convert", "convert"),))
    table = doctor.doctor_table(doctor.examine())
    assert "missing for convert: no-such-package (pip install 'mdrive-sumo[convert]')" in table


def test_a_broken_simulator_is_found_without_breaking_the_doctor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "SIMULATOR_CHECK", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    result = CliRunner().invoke(command)
    assert result.exit_code == 1
    assert "missing for eval, verify: libsumo (exit code -11; on Debian" in result.output


def test_a_missing_extra_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "PACKAGES", (("no-such-package", "convert", "convert"),))
    assert CliRunner().invoke(command).exit_code == 0


def test_netconvert_is_found_beside_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the installed script: `.venv/bin/mdrive-sumo` without an activated environment."""
    monkeypatch.setenv("PATH", "/nowhere")
    found = {check.name: check.found for check in doctor.examine()}["netconvert"]
    if not found:
        pytest.skip("needs netconvert")
    assert found.startswith(sys.prefix)

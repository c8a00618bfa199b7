"""Tools are commands like the others: they have help, end with a sentence, and write nothing in a dry run."""

import pkgutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from testing.paths import ROOT

import tools
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from tools.tool_command import replace_changed_files

MODULES = [f"tools.{module.name}" for module in pkgutil.iter_modules(tools.__path__)]
PARTS = {
    "tools.aim_tables",
    "tools.detector_values",
    "tools.docs_site",
    "tools.model_card_text",
    "tools.paper_values",
    "tools.published_values",
    "tools.seed_runs",
    "tools.tool_command",
    "tools.twin_values",
}
"""Modules of tools that are no commands."""
COMMANDS = sorted({*MODULES} - PARTS)
WITHOUT_DRY_RUN = {
    "tools.codriving_values",
    "tools.draw_fused_grids",
    "tools.draw_training_curves",
    "tools.draw_world_sheets",
    *("tools.compare_platforms", "tools.detector_calibration", "tools.draw_camera_pictures"),
    "tools.sample_episodes",
}
"""Commands that write nothing, or only to a path or with an option that the user names."""


def load_command(name: str) -> click.Command:
    module = import_module(name)
    return import_module(f"{name}.build_suite").main if hasattr(module, "__path__") else module.main


@pytest.mark.parametrize("name", COMMANDS)
def test_every_tool_has_help_and_a_dry_run(name: str) -> None:
    told = CliRunner().invoke(load_command(name), ["--help"])
    assert told.exit_code == 0 and "Usage:" in told.output
    assert ("--dry-run" in told.output) is (name not in WITHOUT_DRY_RUN)


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_options_of_a_tool_are_refused(name: str) -> None:
    told = CliRunner().invoke(load_command(name), ["--no-such-option"])
    assert told.exit_code == 2 and "No such option" in told.output


def test_a_tool_ends_with_a_sentence(tmp_path: Path) -> None:
    for name, arguments, sentence in (
        ("tools.build_lone_suite", [str(tmp_path)], "expected a folder that does not exist yet"),
        ("tools.build_networks", ["--dry-run", "no_such_network"], "network 'no_such_network'"),
        ("tools.write_model_card", ["--note", "fast"], "expected the NAME of a card with these options, found none"),
        ("tools.write_results", ["--dry-run", str(tmp_path)], "--commit: expected the commit"),
        ("tools.write_results", ["--dry-run", "--commit", "abc", str(tmp_path)], "results.json"),
        ("tools.sample_episodes", ["nobody"], "agent: expected one with a row"),
    ):
        told = CliRunner().invoke(load_command(name), arguments)
        assert told.exit_code == 2 and sentence in told.output, (name, told.output)


@pytest.mark.parametrize("name", ["tools.write_results", "tools.write_model_card"])
def test_a_dry_run_finds_the_written_pages_up_to_date(name: str) -> None:
    told = CliRunner().invoke(load_command(name), ["--dry-run"])
    assert told.exit_code == 0 and told.output.endswith(": 0 files would change\n")


def test_a_dry_run_names_what_would_change_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    built, target = tmp_path / "built", tmp_path / "target"
    for folder, text in ((built, "new"), (target, "old")):
        (folder / "inner").mkdir(parents=True)
        (folder / "inner" / "a").write_text(text)
        (folder / "same").write_text("same")
    replace_changed_files(built, target, dry_run=True)
    assert (target / "inner" / "a").read_text() == "old"
    assert capsys.readouterr().out == f"would change: {target / 'inner' / 'a'}\n{target}: 1 files would change\n"
    replace_changed_files(built, target, dry_run=False)
    assert (target / "inner" / "a").read_text() == "new"


@pytest.mark.slow
def test_the_built_suite_is_found_unchanged() -> None:
    command = [sys.executable, "-m", "tools.build_interdrive_suite", "--dry-run"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=True)
    assert told.stdout == f"{find_suite_folder('interdrive@0')}: 0 files would change\n"

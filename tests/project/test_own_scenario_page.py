"""The page "Your own scenario in ten minutes", followed line by line on maps that the test makes."""

import re
import runpy
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.local_executor import run_in_process
from testing.made_network import compile_tee
from testing.opendrive_samples import format_map, format_road
from testing.osm_samples import draw_crossing
from testing.paths import ROOT

import mdrive_sumo as md
from mdrive_sumo.cli import main

PAGE = (ROOT / "docs" / "how-to" / "own-scenario.md").read_text("utf-8")
MAPS = ("junction.net.xml", "town.osm", "road.xodr")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a map of each kind, and the page's new files."""
    monkeypatch.chdir(tmp_path)
    run_in_process(monkeypatch)
    (tmp_path / "junction.net.xml").write_bytes(compile_tee(tmp_path / "plain"))
    (tmp_path / "town.osm").write_text(draw_crossing().write())
    (tmp_path / "road.xodr").write_text(format_map(format_road(length=120)))
    for name, code in re.findall(r"^New file `([^`]+)`:\n\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(code)
    return tmp_path


def list_commands() -> list[list[str]]:
    """Return the commands of the page in their order: indented lines, and those of the console."""
    console = re.findall(r"^```console\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    lines = [*re.findall(r"^    (mdrive-sumo .*)$", PAGE, re.MULTILINE), *"".join(console).splitlines()]
    return [shlex.split(line) for line in lines]


@pytest.mark.slow
def test_every_command_of_the_page_works(folder: Path) -> None:
    commands = list_commands()
    assert [words[3] for words in commands if words[:3] == ["mdrive-sumo", "convert", "network"]] == list(MAPS)
    for program, *arguments in commands:
        if program == "python":
            runpy.run_path(arguments[0])
            continue
        arguments += ["--no-open"] if arguments == ["view", "town"] else []
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 0, (arguments, done.output, done.exception)
    suite = md.load_suite("my_suite")
    assert [scenario.id for scenario in suite] == ["hard_brake", "meet_a_bus", "stop_sign"]
    driven = md.load_run("my_run")
    assert {row.id for row in driven.results[0].scenarios} == {scenario.id for scenario in suite}
    assert (folder / "town.html").is_file() and (folder / "stop_sign.png").is_file()


def test_the_page_writes_each_scenario_in_at_most_ten_lines() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    assert all(len([line for line in block.splitlines() if line.strip()]) <= 10 for block in blocks)

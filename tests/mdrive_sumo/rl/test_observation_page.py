"""The page of an observation shows its numbers; `learn observation` writes it."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import mdrive_sumo as md
from mdrive_sumo.cli.command_line import main
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.observation_page import render_observation_page
from mdrive_sumo.rl.observation_vector import OBJECT_NUMBERS, OWN_NUMBERS, ROUTE_NUMBERS, RULE_NUMBERS, count_numbers

SETTINGS = EnvSettings(grid="lidar", nearest=2, senders=1, message_bytes=16)


def _render() -> str:
    """Return the page of one lorry 20 m ahead and 10 m to the left that looks left, a message, and three points."""
    vector = np.zeros(count_numbers(2, 1, 16), np.float32)
    users = OWN_NUMBERS + ROUTE_NUMBERS + RULE_NUMBERS
    vector[users : users + OBJECT_NUMBERS] = (1, 0.4, 0.2, 0, 1, 0, 0.25, 0.8, 1.0, 1, 0)
    vector[-18:] = (1.0, 0.25, *(value / 255 for value in range(16)))
    grid = np.zeros((2, 64, 64), np.uint8)
    grid[1, 5, 7:9] = 3
    grid[1, 5, 20] = 1
    return render_observation_page(SETTINGS, "<What>", [("Tick", "60")], vector, grid)


def test_the_page_shows_the_numbers() -> None:
    page = _render()
    assert page == _render()
    assert "&lt;What&gt;" in page
    assert 'width="2.5" height="8.0" transform="translate(-10.0 -20.0) rotate(-90.0)" fill="var(--vehicle)"' in page
    assert page.count("<title>1</title>") == 1
    assert "<title>2</title>" not in page  # there is no second road user
    assert "<td>00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f</td>" in page
    assert '<rect x="7" y="5" width="2" height="1"' in page
    assert "points above the ground: 3 of 4096 cells are not 0." in page
    assert "points on the ground: 0 of 4096" in page


@pytest.mark.slow
def test_the_command_writes_the_page_of_a_tick(tmp_path: Path) -> None:
    out = tmp_path / "new" / "page.html"
    scenario = "i25_ins_oppo_boulevard"
    arguments = ["learn", "observation", scenario, "--out", str(out), "--nearest", "3", "--grid", "raster"]
    result = CliRunner().invoke(main, [*arguments, "--tick", "6", "--cav", "2"])
    assert result.exit_code == 0, result.output
    page = out.read_text()
    assert "What cav_2 sees" in page
    assert "8, 0.40 s" in page
    assert re.search(r"self: \d+ of 4096 cells are not 0", page)
    result = CliRunner().invoke(main, [*arguments, "--cav", "9"])
    assert result.exit_code == 2
    assert f"scenario {scenario}: expected CAV 9 to drive in tick 0, found 4 CAVs" in result.output
    result = CliRunner().invoke(main, [*arguments, "--tick", "9000"])
    assert result.exit_code == 2
    assert "expected CAV 0 to drive in tick 9000, found it ended by tick" in result.output
    assert md.Simulation._open is None  # pyright: ignore[reportPrivateUsage] - what runs in this process next needs SUMO

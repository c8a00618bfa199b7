"""What the command line says of itself, and how soon."""

import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from mdrive_sumo.cli import main

pytestmark = pytest.mark.slow

REAL_MAIN = [sys.executable, "-c", "from mdrive_sumo.cli import main; main()"]


def test_a_job_is_imported_without_any_agent() -> None:
    """Each worker process then loads only the agent that it drives, and what that needs."""
    code = (
        "import sys, mdrive_sumo.runs.episode_job; print(*(name for name in sys.modules if name.startswith('mdrive')))"
    )
    done = subprocess.run((sys.executable, "-c", code), capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert {name for name in loaded if name.startswith("mdrive_sumo.agents.")} == {"mdrive_sumo.agents.registry"}
    assert not {name.split(".")[1] for name in loaded - {"mdrive_sumo"}} & {"planning", "negotiation", "perception"}


def test_help_names_every_command_without_importing_any_of_them() -> None:
    code = (
        "import sys\n"
        "from mdrive_sumo.cli import main\n"
        "main(['--help'], standalone_mode=False)\n"
        "heavy = {'numpy', 'pydantic', 'libsumo', 'shapely', 'matplotlib', 'sumolib'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
    commands = (
        "eval",
        "list",
        "show",
        "view",
        "verify",
        "rescore",
        "compare",
        "validate",
        "schema",
        "doctor",
        "convert",
    )
    places = [ended.stdout.index(f"\n  {command} ") for command in commands]
    assert places == sorted(places)


def test_help_starts_within_the_time_that_a_user_does_not_notice() -> None:
    """0.4 s is the target; on a slow or busy machine, a few times what Python and click alone take there."""

    def best_of_three(command: list[str]) -> float:
        times: list[float] = []
        for _ in range(3):
            before = time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            times.append(time.perf_counter() - before)
        return min(times)

    bare = best_of_three([sys.executable, "-c", "import click"])
    assert best_of_three([*REAL_MAIN, "--help"]) < max(0.4, 4 * bare)


@pytest.mark.parametrize(
    "command", ["eval", "list", "show", "view", "export", "verify", "rescore", "compare", "validate"]
)
def test_every_command_explains_itself(command: str) -> None:
    answer = CliRunner().invoke(main, [command, "--help"])
    assert answer.exit_code == 0, answer.output
    assert "Usage:" in answer.output


def test_version() -> None:
    assert CliRunner().invoke(main, ["--version"]).output.startswith("mdrive-sumo, version 0.")

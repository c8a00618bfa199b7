"""Run `mdrive-sumo convert` in process."""

from pathlib import Path

from click.testing import CliRunner, Result

from mdrive_sumo.cli import main


def run(*arguments: object) -> Result:
    """Run `mdrive-sumo convert` with the arguments."""
    return CliRunner().invoke(main, ["convert", *map(str, arguments)])


def refused(tmp_path: Path, *arguments: object) -> str:
    """Return the error sentence of a command that must fail and leave nothing behind."""
    before = sorted(tmp_path.iterdir())
    done = run(*arguments, "--out", tmp_path / "out", "--workers", "1")
    assert done.exit_code == 2, (done.exit_code, done.output, done.exception)
    assert sorted(tmp_path.iterdir()) == before
    assert done.stdout == ""
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert "Traceback" not in done.stderr
    return sentence.removeprefix("Error: ")

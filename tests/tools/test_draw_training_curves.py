"""Training curves of several trainings, each with its rounds."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from tools import draw_training_curves
from tools.draw_training_curves import join_rounds


def save_curves(path: Path, steps: int) -> Path:
    rows = [f"{step},loss/total,{10 / step}\n{step},loss/box,1.0\n" for step in range(1, steps + 1)]
    path.write_text("step,name,value\n" + "".join(rows) + f"{steps},validation/clean,0.5\n")
    return path


@pytest.mark.slow
def test_rounds_follow_each_other_and_the_picture_has_a_panel_for_each_training(tmp_path: Path) -> None:
    first, second = save_curves(tmp_path / "1.csv", 4), save_curves(tmp_path / "2.csv", 2)
    curves, begins = join_rounds([first, second])
    assert [step for step, _ in curves["loss/total"]] == [1, 2, 3, 4, 5, 6] and begins == [4]
    assert curves["validation/clean"] == [(4, 0.5), (6, 0.5)] and "loss/box" not in curves
    words = [str(tmp_path / "picture"), f"tcp={first},{second}", f"vad={second}"]
    done = CliRunner().invoke(draw_training_curves.main, words)
    assert done.exit_code == 0 and (tmp_path / "picture.png").is_file(), done.output


def test_what_is_no_curve_is_one_sentence(tmp_path: Path) -> None:
    for word, says in (
        (f"tcp={tmp_path / 'none.csv'}", "expected a curves.csv with loss/total"),
        ("tcp", "NAME=CURVES"),
    ):
        done = CliRunner().invoke(draw_training_curves.main, [str(tmp_path / "picture"), word])
        assert done.exit_code == 2 and says in done.output

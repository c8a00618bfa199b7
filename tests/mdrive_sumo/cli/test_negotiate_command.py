"""`mdrive-sumo negotiate`: a round at a tick, a person who takes part, bad input."""

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main as command_line
from mdrive_sumo.core.errors import InputError

pytestmark = pytest.mark.slow

SCENARIO = ("negotiate", "i03*", "--suite", "interdrive@0")


def invoke(*arguments: str, typed: str = "") -> Result:
    return CliRunner().invoke(command_line, [*SCENARIO, *arguments], input=typed)


def test_a_round_is_held_and_judged() -> None:
    lines = invoke("--tick", "8").output.splitlines()
    assert lines[0] == "i03_ins_c_main_street_left, tick 8 (0.4 s): A is CAV 1, B is CAV 0"
    assert [line.split(":")[0] for line in lines[1:3]] == ["A says", "B says"]
    assert lines[3].startswith("agreed, says A: A faster, B slower, in this order; consensus 100%")
    assert lines[4].startswith("critic: safety 0.")
    assert lines[5] == "all can keep to it"


TYPED = {
    "object B>A keep: I am late": "A says: object B>A keep: I am late",
    "after you": "A says: after you",
    "": "A is silent",
}


@pytest.mark.parametrize("typed", TYPED)
def test_a_person_is_told_what_its_car_knows_and_takes_part(typed: str) -> None:
    done = invoke("--tick", "8", "--as", "1", typed=f"{typed}\n")
    assert done.exit_code == 0
    assert "  me A straight" in done.output
    assert TYPED[typed] in done.output.splitlines()
    assert "agreed, says A:" in done.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--tick", "8", "--as", "7"), "--as: expected a CAV of i03_ins_c_main_street_left (0, 1), found '7'"),
        (("--tick", "60"), "tick 60: expected a tick with CAVs in conflict, such as "),
        (("--tick", "99999"), "expected a tick with CAVs in conflict, such as "),
    ],
)
def test_what_cannot_be_is_one_sentence(arguments: tuple[str, ...], words: str) -> None:
    done = invoke(*arguments)
    assert done.exit_code == 2 or isinstance(done.exception, InputError)
    assert words in f"{done.output}{done.exception}"

"""`study attacks`: differences by hand, and the command from end to end."""

import json
from pathlib import Path

import pytest
from testing.study_samples import invoke, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.study.attacks import AttackRow, summarise_attacks
from mdrive_sumo.study.attacks_files import attacks_csv, build_attacks_table

PLACES = [f"s{n}" for n in range(12)]


def make_row(agent: str, has_defence: bool | None, attack: str, ds: float, void: str = "") -> AttackRow:
    scenarios = [
        make_scenario(name, ds + n % 2, place=name, status="void" if name == void else "ok", reason="")
        for n, name in enumerate(PLACES)
    ]
    return AttackRow(agent, has_defence, attack, (make_run(*scenarios, agent=agent),))


def make_rows(void: str = "") -> list[AttackRow]:
    return [
        make_row("single", None, "none", 60.0),
        make_row("sharing", True, "none", 80.0),
        make_row("sharing", True, "phantom", 75.0, void),
        make_row("sharing", False, "none", 80.0),
        make_row("sharing", False, "phantom", 30.0),
    ]


def test_differences_are_paired_with_the_rows_that_they_name() -> None:
    lines = summarise_attacks(make_rows()).lines
    found = [
        tuple(None if part is None else part["ds"].mean for part in (one.to_alone, one.to_honest, one.to_undefended))
        for one in lines
    ]
    assert found == [
        (None, None, None), (20.0, None, 0.0), (15.0, -5.0, 45.0), (20.0, None, None), (-30.0, -50.0, None),
    ]  # fmt: skip
    assert lines[4].to_alone is not None and lines[4].to_alone["ds"].ends == (-30.0, -30.0)


def test_a_scenario_that_is_void_once_counts_nowhere() -> None:
    summary = summarise_attacks(make_rows(void="s3"))
    assert (summary.scenarios, summary.void) == (11, 1)
    with pytest.raises(InputError, match="study attacks: expected scenarios that are void in no run, found none"):
        summarise_attacks([make_row("single", None, "none", 0.0, void) for void in PLACES])


def test_the_table_says_which_rows_have_a_defence() -> None:
    summary = summarise_attacks(make_rows())
    table = build_attacks_table(summary)
    assert [column.label for column in table.columns][3:] == ["DS", "- single", "- honest", "- undefended"]
    assert "sharing,off,phantom,to_alone,ds,-30.000000,-30.000000,-30.000000" in attacks_csv(summary)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--attack", "phantom", "--attack", "phantom"), "study: --attack: expected different attacks"),
        (("--attack", "none"), "study: --attack: expected different attacks, found none"),
        (("--attack", "lie"), "attack: expected one of none, phantom"),
        (("--attack", "hide:by=nobody"), "--attack hide:by=nobody: expected attackers among"),
        (("--attack", "hide", "--comm", "off"), "expected a channel over which stations can lie, found --comm off"),
        (("--agents", "single"), "study: --alone: expected an agent that is not among --agents, found 'single'"),
        (("--agents", "sharing,sharing"), "study: --agents: expected different agents"),
    ],
)
def test_bad_input_gets_one_sentence(tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    found = invoke("study", "attacks", "--suite", "interdrive@0", "--scenario", "i26*", *words, "--out", tmp_path / "x")
    assert found.exit_code == 2 and sentence in found.output and "Traceback" not in found.output


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_the_command_writes_its_files(tmp_path: Path) -> None:
    out = tmp_path / "study"
    suite = ("--suite", "v2xpnp@0", "--scenario", "corridor_014")  # two CAVs for nine seconds
    options = ("--agents", "sharing", "--attack", "phantom", "--seeds", "1", "--workers", "1", "--no-record")
    found = invoke("study", "attacks", *suite, *options, "--out", out)
    assert found.exit_code == 0, found.output
    page = json.loads((out / "attacks.json").read_text())
    keys = [(line["agent"], line["defence"], line["attack"]) for line in page["lines"]]
    assert keys == [
        ("single", None, "none"),
        ("sharing", True, "none"), ("sharing", True, "phantom"),
        ("sharing", False, "none"), ("sharing", False, "phantom"),
    ]  # fmt: skip
    digests = [[run["scenarios"]["corridor_014"]["digest"] for run in row["runs"]] for row in page["rows"]]
    assert digests[1] == digests[3] and digests[2] != digests[4] != digests[1]  # the defence costs nothing without lies
    assert "# v2xpnp@0: senders that lie" in (out / "attacks.md").read_text()

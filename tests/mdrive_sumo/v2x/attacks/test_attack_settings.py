"""`--attack`: texts, bad ones, and which stations attack."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.v2x.attacks.attack_settings import PARAMETERS, AttackKind, parse_attack
from mdrive_sumo.v2x.attacks.attackers import check_attackers, choose_attackers

CAVS, RSUS = ["0", "1", "2", "3"], ["rsu_1", "rsu_2"]


def choose(text: str, seed: int = 0, scenario: str = "place") -> frozenset[str]:
    attack = parse_attack(text)
    assert attack is not None
    return choose_attackers(attack, CAVS, RSUS, scenario, seed)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("phantom", "phantom"),
        ("phantom:by=1+0", "phantom:by=0+1"),
        ("shift:rate=0.30,most=12.5", "shift:most=12.5"),
        ("forge-mcm:claim=priority", "forge-mcm"),
        ("forge-mcm: claim=yield , share=50", "forge-mcm:share=50,claim=yield"),
        ("flood:bytes=1e5,among=all", "flood:among=all,bytes=100000"),
    ],
)
def test_a_text_has_one_canonical_form(text: str, canonical: str) -> None:
    attack = parse_attack(text)
    assert attack is not None and attack.text == canonical
    assert parse_attack(canonical) == attack


def test_none_is_no_attack() -> None:
    assert parse_attack("none") is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "attack: expected one of none, phantom, hide, shift, forge-mcm, replay, flood, found ''"),
        ("fantom", "found 'fantom'; did you mean 'phantom'?"),
        ("phantom:", "attack phantom: expected options among by, share, among, found ''"),
        ("hide:rate=1", "expected options among by, share, among, found 'rate=1'"),
        ("phantom:claim=yield", "expected options among by, share, among, found 'claim=yield'"),
        ("shift:rate=-1", "attack shift: rate: expected a number from 0.01 to 50 m/s, found '-1'"),
        ("shift:rate=nan", "found 'nan'"),
        ("shift:most=inf", "attack shift: most: expected a number from 0.1 to 300 m, found 'inf'"),
        ("replay:delay=soon", "attack replay: delay: expected a number from 0.1 to 60 s, found 'soon'"),
        ("flood:bytes=2000000", "expected a number from 1 to 1e+06 bytes/s"),
        ("shift:rate=1,rate=2", "attack shift: expected rate once, found it twice"),
        ("phantom:share=0", "attack: share: expected a whole percentage from 1 to 100, found '0'"),
        ("phantom:share=101", "found '101'"),
        ("phantom:share=2.5", "found '2.5'"),
        ("phantom:among=trucks", "attack phantom: among: expected one of cavs, rsus, all, found 'trucks'"),
        ("forge-mcm:claim=both", "attack forge-mcm: claim: expected one of priority, yield, found 'both'"),
        ("phantom:by=0+0", "attack: by: expected different ids of stations with + between them, found '0+0'"),
        ("phantom:by=", "attack: by: expected different ids"),
        ("phantom:by=0,share=50", "attack phantom: expected by=... or share=... and among=..., found both"),
    ],
)
def test_a_bad_text_gets_one_sentence(text: str, expected: str) -> None:
    with pytest.raises(InputError) as error:
        parse_attack(text)
    assert expected in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "rsus", "expected"),
    [
        ("phantom:by=4", RSUS, "--attack phantom:by=4: expected attackers among 0, 1, 2, 3, rsu_1, rsu_2, found '4'"),
        ("hide:by=rsu1", RSUS, "found 'rsu1'; did you mean 'rsu_1'?"),
        ("hide:among=rsus", [], "--attack hide:among=rsus: expected scenarios with a road-side unit, found none"),
    ],
)
def test_attackers_that_do_not_exist_are_refused(text: str, rsus: list[str], expected: str) -> None:
    attack = parse_attack(text)
    assert attack is not None
    with pytest.raises(InputError) as error:
        check_attackers(attack, CAVS, rsus)
    assert expected in str(error.value)


def test_one_cav_attacks_by_default_and_any_kind_has_the_same() -> None:
    drawn = {choose(str(kind)) for kind in AttackKind}
    assert len(drawn) == 1 and len(attackers := drawn.pop()) == 1 and attackers < {*CAVS}
    assert len({choose("phantom", seed) for seed in range(30)}) == len(CAVS)
    assert len({choose("phantom", scenario=f"s{n}") for n in range(30)}) == len(CAVS)


@given(st.integers(1, 100), st.integers(1, 100), st.sampled_from(["cavs", "rsus", "all"]), st.integers(0, 99))
def test_a_higher_share_keeps_the_attackers_of_a_lower_one(a: int, b: int, among: str, seed: int) -> None:
    low, high = (choose(f"hide:share={share},among={among}", seed) for share in sorted((a, b)))
    stations = {"cavs": CAVS, "rsus": RSUS, "all": CAVS + RSUS}[among]
    assert len(low) >= 1 and low <= high <= {*stations}
    assert choose(f"hide:share=100,among={among}", seed) == {*stations}


def test_named_attackers_are_those_that_the_scenario_has() -> None:
    assert choose("phantom:by=1+rsu_2+9") == {"1", "rsu_2"}


def test_only_kinds_with_numbers_have_parameters_and_defaults_lie_in_their_bounds() -> None:
    assert {*PARAMETERS} == {AttackKind.SHIFT, AttackKind.REPLAY, AttackKind.FLOOD}
    for parameters in PARAMETERS.values():
        assert all(one.low <= one.default <= one.high for one in parameters.values())

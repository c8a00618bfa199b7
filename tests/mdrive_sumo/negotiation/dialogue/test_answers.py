"""What is said and agreed as text: the form, its defects, and letters in place of station ids."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.negotiation.dialogue.answers import (
    LETTERS,
    STANCES,
    Agreement,
    OrderProposal,
    assign_letters,
    format_agreement,
    format_proposal,
    parse_agreement,
    parse_proposal,
    replace_letters,
    restore_letters,
)
from mdrive_sumo.v2x.messages import Intention

ORDERS = st.integers(2, 8).flatmap(lambda count: st.permutations(LETTERS[:count])).map(tuple)


@given(ORDERS, st.sampled_from(STANCES), st.sampled_from(Intention), st.sampled_from(("", "I pass behind B, at 2.5 s")))
def test_a_proposal_is_read_as_it_was_written(
    order: tuple[str, ...], stance: str, action: Intention, words: str
) -> None:
    proposal = OrderProposal(stance, order, action, words)
    assert parse_proposal(format_proposal(proposal), "".join(sorted(order))) == proposal


@given(ORDERS, st.data(), st.integers(0, 10))
def test_an_agreement_is_read_as_it_was_written(order: tuple[str, ...], data: st.DataObject, tenths: int) -> None:
    actions = {member: data.draw(st.sampled_from(Intention)) for member in order}
    agreement = Agreement(order, actions, tenths / 10)
    assert parse_agreement(format_agreement(agreement), "".join(sorted(order))) == agreement


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected a stance, an order such as B>A and an action"),
        ("Sure! B goes first.", "expected a stance, an order such as B>A and an action"),
        ("insist B>A keep", "stance: expected one of propose, accept, object, found 'insist'"),
        ("propose B>C keep", "order: expected each of A, B once, found B>C"),
        ("propose B>A>B keep", "order: expected each of A, B once, found B>A>B"),
        ("propose B keep", "order: expected each of A, B once, found B"),
        ("propose B>A fly", "action: expected one of stop, slower, keep, faster, found 'fly'"),
    ],
)
def test_a_defect_of_a_proposal_is_named(text: str, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        parse_proposal(text, "AB")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("propose B>A keep", "expected an order such as B>A, an action for each of its members and a consensus"),
        ("B>A keep 90", "actions: expected 2, found 1"),
        ("B>A keep fly 90", "action: expected one of"),
        ("B>H keep stop 90", "order: expected each of A, B once, found B>H"),
        ("B>A keep stop 95", "consensus: expected 0, 10, ... or 100, found 95"),
        ("B>A keep stop " + "9" * 5000, "consensus: expected 0, 10, ... or 100, found 9999"),
    ],
)
def test_a_defect_of_an_agreement_is_named(text: str, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        parse_agreement(text, "AB")


def test_all_members_find_the_same_letters() -> None:
    assert assign_letters(("f3", "0a", "7c")) == assign_letters(("7c", "f3", "0a")) == {"0a": "A", "7c": "B", "f3": "C"}
    with pytest.raises(ValueError, match="at most 8 members, found 9"):
        assign_letters([str(i) for i in range(9)])


@given(st.lists(st.text("0123456789abcdef", min_size=8, max_size=8), min_size=2, max_size=8, unique=True))
def test_station_ids_replace_letters_and_back(stations: list[str]) -> None:
    letters = assign_letters(stations)
    text = f"propose {'>'.join(letters.values())} keep: Behind A, at B's side, I see 2 cars"
    sent = replace_letters(text, {letter: station for station, letter in letters.items()})
    assert stations[0] in sent and "Behind" in sent
    assert restore_letters(sent, letters) == text


def test_a_station_id_may_be_part_of_another() -> None:
    letters = {"car": "A", "car-2": "B"}
    assert restore_letters("accept car-2>car keep: cars", letters) == "accept B>A keep: cars"

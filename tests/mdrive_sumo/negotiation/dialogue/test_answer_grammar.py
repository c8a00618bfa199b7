"""The grammar: whatever is chosen, the answer can be read, fits into a message, and every right answer is allowed."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.negotiation.dialogue.answer_grammar import MAX_ANSWER_ENTRIES, AnswerEntries, AnswerGrammar
from mdrive_sumo.negotiation.dialogue.answers import LETTERS, parse_agreement, parse_proposal, replace_letters
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, END, SAY, load_vocabulary

VOCABULARY = load_vocabulary()
ENTRIES = AnswerEntries.find(VOCABULARY)


def write_anything(grammar: AnswerGrammar, draw: random.Random) -> list[int]:
    written: list[int] = []
    while not grammar.is_complete:
        written.append(draw.choice(grammar.allowed.tolist()))
        grammar.advance(written[-1])
    return written


@given(st.integers(2, 8), st.integers(0, 2**32), st.booleans())
def test_any_proposal_can_be_read_and_fits(count: int, seed: int, has_words: bool) -> None:
    letters = LETTERS[:count]
    stations = {letter: f"{ord(letter):08x}" for letter in letters}
    grammar = AnswerGrammar(ENTRIES, SAY, letters, [8] * count, has_words=has_words)
    written = write_anything(grammar, random.Random(seed))
    assert written[-1] == END and len(written) <= MAX_ANSWER_ENTRIES
    text = VOCABULARY.decode(written)
    proposal = parse_proposal(text, letters)
    assert has_words or not proposal.words
    assert len(replace_letters(text, stations).encode()) <= 200
    assert text.isprintable() and not set("<>|[]") & set(proposal.words)


@given(st.integers(2, 8), st.integers(0, 2**32))
def test_any_agreement_can_be_read(count: int, seed: int) -> None:
    letters = LETTERS[:count]
    written = write_anything(AnswerGrammar(ENTRIES, AGREE, letters), random.Random(seed))
    assert set(parse_agreement(VOCABULARY.decode(written), letters).action_by_member) == set(letters)


def test_words_end_where_the_message_is_full() -> None:
    grammar = AnswerGrammar(ENTRIES, SAY, "AB", max_bytes=len("accept A>B stop: keep"))
    for entry in VOCABULARY.encode("accept A>B stop:"):
        grammar.advance(entry)
    assert END not in grammar.allowed
    for piece in VOCABULARY.encode(" kee"):
        grammar.advance(piece)
    assert {len(VOCABULARY.pieces[entry]) for entry in grammar.allowed.tolist()} == {0, 1}
    grammar.advance(VOCABULARY.encode("p")[0])
    assert grammar.allowed.tolist() == [END]


def test_a_full_head_leaves_no_words() -> None:
    grammar = AnswerGrammar(ENTRIES, SAY, "AB", [80, 80])
    for entry in VOCABULARY.encode("accept A>B stop"):
        grammar.advance(entry)
    assert END in grammar.allowed
    long = AnswerGrammar(ENTRIES, SAY, "AB", [100, 100])
    for entry in VOCABULARY.encode("accept A>B stop"):
        long.advance(entry)
    assert long.allowed.tolist() == [END]


def test_a_wrong_entry_is_refused() -> None:
    grammar = AnswerGrammar(ENTRIES, SAY, "AB")
    with pytest.raises(ValueError, match="expected one of 3 entries of the grammar"):
        grammar.advance(END)

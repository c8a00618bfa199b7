"""Suggestions for mistyped names."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.suggestion import describe_unknown, suggest_name

NAMES = st.lists(st.text("abcdefgh_-", min_size=3, max_size=12), min_size=1, max_size=6, unique=True)


@pytest.mark.parametrize(
    ("name", "known", "suggestion"),
    [
        ("idmm", ("single", "idm"), "; did you mean 'idm'?"),
        ("Realistic", ("ideal", "realistic"), "; did you mean 'realistic'?"),
        ("Carefull", ("Careful", "Other"), "; did you mean 'Careful'?"),
        ("zzz", ("single", "idm"), ""),
        ("", ("idm",), ""),
    ],
)
def test_a_similar_name_is_suggested(name: str, known: tuple[str, ...], suggestion: str) -> None:
    assert suggest_name(name, known) == suggestion


@given(NAMES, st.data())
def test_a_name_with_other_capitals_is_found_and_any_suggestion_is_known(names: list[str], data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(names))
    assert suggest_name(name.upper(), names) == f"; did you mean {name!r}?"
    found = suggest_name(data.draw(st.text(max_size=12)), names)
    assert found == "" or found in {f"; did you mean {one!r}?" for one in names}


def test_a_sentence_names_what_exists_and_cuts_what_was_found() -> None:
    assert describe_unknown("c", ("a", "b"), "or a folder") == "expected one of a, b or a folder, found 'c'"
    assert len(describe_unknown("x" * 1000, ("a",))) < 100

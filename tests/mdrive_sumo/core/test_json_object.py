"""Texts that are no JSON objects."""

import pytest

from mdrive_sumo.core.json_object import parse_json_object


def test_an_object_is_read() -> None:
    assert parse_json_object('{"loss": 0.5}', "comm") == {"loss": 0.5}


@pytest.mark.parametrize("text", ["", "{", "null", "[]", "5", "[" * 3000, "9" * 5000])
def test_anything_else_is_a_value_error_of_one_sentence(text: str) -> None:
    with pytest.raises(ValueError, match="comm: expected a JSON object, found '") as caught:
        parse_json_object(text, "comm")
    assert len(str(caught.value)) < 120

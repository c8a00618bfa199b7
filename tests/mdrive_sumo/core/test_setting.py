"""What follows from the fields of a settings class: names, defaults, and the checks of what users and files give."""

from dataclasses import dataclass, field
from enum import StrEnum, auto
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.setting import Setting, list_settings, setting


class Shade(StrEnum):
    LIGHT = auto()
    DARK = auto()


@dataclass(frozen=True)
class Frame:
    width_mm: float = setting(20.0, key="width", unit="mm", bounds=(1, 50), help="Of the frame.")


@dataclass(frozen=True)
class Picture:
    title: str = setting("", help="Its title.")
    frame: Frame = field(default_factory=Frame)
    back: Frame | None = None
    shade: Shade = setting(Shade.LIGHT, help="How dark it is.")
    copies: int = setting(1, bounds=(1, None))
    price: float = setting(1.0)
    signed: bool = setting(True)
    printed: bool = setting(False)
    out: Path | None = setting(None)
    owner: str = "nobody asks for it"


SETTINGS = {one.key: one for one in list_settings(Picture)}


def test_settings_are_listed_with_those_of_the_parts_in_the_order_of_the_fields() -> None:
    assert [one.key for one in list_settings(Picture)] == [
        *("title", "width", "width", "shade", "copies", "price", "signed", "printed", "out"),
    ]
    assert (SETTINGS["width"].owner, SETTINGS["width"].field, SETTINGS["width"].default) == (Frame, "width_mm", 20.0)


def test_paths_are_no_scalars_and_choices_are_stored_as_texts() -> None:
    assert {key for key, one in SETTINGS.items() if not one.is_scalar} == {"out"}
    assert SETTINGS["shade"].write(Shade.DARK) == "dark" and SETTINGS["shade"].read("dark") is Shade.DARK
    assert (SETTINGS["shade"].typed_default, SETTINGS["out"].typed_default) == ("light", None)


@pytest.mark.parametrize(
    ("key", "given", "value"),
    [
        ("shade", "dark", Shade.DARK),
        ("shade", Shade.DARK, Shade.DARK),
        ("width", 3, 3.0),
        ("width", np.float32(3), 3.0),
        ("copies", np.int64(3), 3),
        ("signed", False, False),
        ("signed", np.bool_(False), False),
        ("out", "a/b", Path("a/b")),
        ("out", None, None),
    ],
)
def test_texts_and_typed_values_are_read(key: str, given: Any, value: Any) -> None:
    parsed = SETTINGS[key].parse(given)
    assert parsed == value and type(parsed) is type(value)


@pytest.mark.parametrize(
    ("key", "given", "sentence"),
    [
        ("shade", "drak", "shade: expected one of light, dark, found 'drak'; did you mean 'dark'?"),
        ("shade", None, "shade: expected one of light, dark, found 'None'"),
        ("width", 51, "width: expected a number from 1 to 50 [mm], found 51"),
        ("width", float("nan"), "width: expected a number from 1 to 50 [mm], found nan"),
        ("width", "3", "width: expected a number from 1 to 50 [mm], found '3'"),
        ("width", True, "width: expected a number from 1 to 50 [mm], found True"),
        ("width", 10**400, f"width: expected a number from 1 to 50 [mm], found {10**39}"),
        ("width", np.array([3.0, 4.0]), "width: expected a number from 1 to 50 [mm], found array([3., 4.])"),
        ("price", 10**400, f"price: expected a number, found {10**39}"),
        ("price", float("inf"), "price: expected a number, found inf"),
        ("copies", 1.5, "copies: expected a whole number from 1, found 1.5"),
        ("copies", 0, "copies: expected a whole number from 1, found 0"),
        ("copies", True, "copies: expected a whole number from 1, found True"),
        ("signed", "no", "signed: expected True or False, found 'no'"),
        ("title", 3, "title: expected a text, found 3"),
        ("out", 3, "out: expected a path, found 3"),
    ],
)
def test_bad_input_gets_a_sentence(key: str, given: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        SETTINGS[key].parse(given)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(("key", "stored"), [("shade", 1), ("shade", "drak"), ("copies", 1.0), ("copies", True)])
def test_a_corrupt_value_of_a_file_is_refused(key: str, stored: object) -> None:
    with pytest.raises((TypeError, ValueError)):
        SETTINGS[key].read(stored)


def test_only_what_is_not_the_default_is_part_of_a_folder_name() -> None:
    changed = Picture(frame=Frame(3.5), shade=Shade.DARK, signed=False, printed=True)
    own = [one for one in list_settings(Picture) if one.owner is Picture and one.is_scalar]
    assert [one.name_value(getattr(Picture(), one.field)) for one in own] == [""] * len(own)
    assert [name for one in own if (name := one.name_value(getattr(changed, one.field)))] == [
        *("dark-shade", "nosigned", "printed"),
    ]
    assert SETTINGS["width"].name_value(3.5) == "3.5-width"


def test_a_label_has_spaces() -> None:
    assert Setting(key="agent_clock").label == "agent clock"

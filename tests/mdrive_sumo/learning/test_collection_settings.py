"""What decides the samples of a data set."""

import re
from dataclasses import fields, replace
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning import collection_settings
from mdrive_sumo.learning.collection_settings import EXPERTS, CollectionSettings

PLAIN = CollectionSettings("train", 3, "omniscient", ("vad",))
OTHERS = {
    "split": "val",
    "seed": 4,
    "expert": "single",
    "rigs": ("tcp", "vad"),
    "perturbation": 0.5,
    "mix": 0.25,
    "round": 1,
    "share": 0.5,
    "suite": "interdrive",
}
"""Another value of every field but the learner's weights, and the folder of places, which decides nothing."""


@pytest.fixture(autouse=True)
def quick_checksum(monkeypatch: pytest.MonkeyPatch) -> None:
    """The checksum of all code takes a quarter of a second, and is the same for all settings."""
    monkeypatch.setattr(collection_settings, "compute_code_checksum", lambda: "code")


def test_every_setting_makes_another_data_set() -> None:
    assert set(OTHERS) == {field.name for field in fields(CollectionSettings)} - {"driver", "places"}
    others = [replace(PLAIN, **{name: value}).fingerprint for name, value in OTHERS.items()]
    assert PLAIN.fingerprint not in others
    assert len({str(one) for one in others}) == len(others)
    assert replace(PLAIN).fingerprint == PLAIN.fingerprint


def test_the_weights_of_a_learner_count_by_their_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class System:
        name, rig = "vad", "vad"

    monkeypatch.setattr(collection_settings, "find_driver_system", lambda _: System)
    first, same, other = (tmp_path / name for name in ("a.onnx", "b.onnx", "c.onnx"))
    first.write_bytes(b"1")
    same.write_bytes(b"1")
    other.write_bytes(b"2")
    driven = replace(PLAIN, driver=first)
    assert driven.fingerprint != PLAIN.fingerprint
    assert replace(PLAIN, driver=same).fingerprint == driven.fingerprint
    assert replace(PLAIN, driver=other).fingerprint != driven.fingerprint
    with pytest.raises(
        InputError, match=r"--driver .*a\.onnx: expected the rig that it sees with, --rig vad, found none"
    ):
        replace(driven, rigs=())


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"split": "trial"}, "^--split: .*trial"),
        ({"expert": "omnicient"}, "^--expert: .*omnicient"),
        (
            {"driver": Path("/nowhere.onnx")},
            r"^--driver /nowhere\.onnx: expected a file with weights \(ONNX\), found none$",
        ),
    ],
)
def test_a_mistake_is_named_by_its_option(change: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        replace(PLAIN, **change)


def test_episodes_have_seeds_and_names_of_their_own() -> None:
    settings = (PLAIN, *(replace(PLAIN, **{name: OTHERS[name]}) for name in ("split", "seed", "round")))
    seeds = {one.derive_episode_seed(index) for one in settings for index in range(50)}
    names = {one.format_episode(index) for one in settings for index in range(50)}
    assert len(seeds) == len(names) == 200
    assert all(re.fullmatch(r"[a-z0-9-]+", name) for name in names)
    ordered = [PLAIN.format_episode(index) for index in (9, 10, 123_456)]
    assert ordered == sorted(ordered)


@pytest.mark.parametrize("expert", EXPERTS)
def test_every_cav_has_an_expert_of_its_own(expert: str) -> None:
    settings = replace(PLAIN, expert=expert)
    assert settings.build_expert() is not settings.build_expert()

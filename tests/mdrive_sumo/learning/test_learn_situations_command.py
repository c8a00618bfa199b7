"""`learn situations` and `learn dialogues`: what is tried does not change the drive; equal commands, equal bytes."""

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import LocalExecutor

from mdrive_sumo.cli import main
from mdrive_sumo.learning.dialogue import agreement_search
from mdrive_sumo.learning.dialogue.dialogue_files import read_dialogues
from mdrive_sumo.learning.dialogue.situation_collection import INDEX_NAME, list_situation_files
from mdrive_sumo.learning.dialogue.situations import Situation, read_situations
from mdrive_sumo.negotiation.dialogue.answers import LETTERS
from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


def learn(*words: object) -> Result:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
        patch.setattr("mdrive_sumo.learning.dialogue.dialogue_collection.make_executor", LocalExecutor)
        patch.setattr(agreement_search, "HORIZON_TICKS", 30)
        return CliRunner().invoke(main, ["learn", *map(str, words)])


def collect(suite: Path, folder: Path, *words: object) -> Result:
    return learn("situations", "--split", "train", "--scenarios", 1, "--suite", suite, "--out", folder, *words)


def read_all(folder: Path) -> list[Situation]:
    return [one for path in list_situation_files(folder)[1] for one in read_situations(path)]


@pytest.fixture(scope="module")
def collected(short_suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the situations of a scenario, all searched; never changed."""
    folder = tmp_path_factory.mktemp("situations") / "set"
    ended = collect(short_suite, folder, "--searched", 1, "--orders", 2)
    assert ended.exit_code == 0, ended.output
    return folder


def test_orders_that_are_tried_do_not_change_the_drive(short_suite: Path, collected: Path, tmp_path: Path) -> None:
    assert collect(short_suite, tmp_path / "plain", "--searched", 0).exit_code == 0
    found, plain = read_all(collected), read_all(tmp_path / "plain")
    assert [replace(one, outcomes=()) for one in found] == plain
    assert len(found) >= 5 and all(len(one.outcomes) == 2 for one in found)
    for one in found:
        assert {"passing", "rule", "omniscient"} == set(one.orders)
        assert all(sorted(order) == list(LETTERS[: len(order)]) for order in one.orders.values())
        assert one.outcomes[0].order == one.orders["passing"] and 0.0 <= one.outcomes[0].progress < 2.0
        assert [view.me for view in one.views] == list(one.letters) and one.scenario == "i12_ins_sl_old_town"
    assert any(a.progress != b.progress for one in found for a, b in [one.outcomes])


def test_dialogues_are_written_twice_the_same_and_read(collected: Path, tmp_path: Path) -> None:
    for name in ("first", "second"):
        ended = learn("dialogues", "--situations", collected, "--out", tmp_path / name, "--repeats", 3)
        assert ended.exit_code == 0, ended.output
    first, second = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("first", "second")
    )
    assert first == second
    samples = read_dialogues(tmp_path / "first", load_vocabulary().digest)
    assert len(samples) > 6 * len(read_all(collected)) and len(set(samples.places)) == 1
    assert f"{len(samples)} dialogues and " in ended.output
    twin = learn(
        "dialogues", "--situations", collected, "--out", tmp_path / "twin", "--repeats", 3, "--without", "words"
    )
    silent = read_dialogues(tmp_path / "twin", load_vocabulary().digest)
    assert twin.exit_code == 0 and len(silent) == len(samples) and silent.length.mean() < samples.length.mean() - 10


def test_folders_of_two_splits_are_refused_and_of_one_are_added(collected: Path, tmp_path: Path) -> None:
    both = "--situations", collected, "--situations"
    ended = learn("dialogues", *both, collected, "--out", tmp_path / "out", "--repeats", 1)
    assert f"about {2 * len(read_all(collected))} situations" in ended.output
    (tmp_path / INDEX_NAME).write_text('{"format": "mdrive-sumo situations 1", "split": "val", "files": ["x"]}')
    ended = learn("dialogues", *both, tmp_path, "--out", tmp_path / "out")
    assert ended.exit_code == 2 and "expected situations of the split train, as before, found val" in ended.output


def test_a_collection_goes_on_and_another_one_is_refused(short_suite: Path, collected: Path) -> None:
    again = collect(short_suite, collected, "--searched", 1, "--orders", 2)
    assert again.exit_code == 0 and "continuing: 1 of 1 scenarios are there" in again.output
    other = collect(short_suite, collected, "--searched", 0.5, "--orders", 2)
    assert other.exit_code == 2 and "found one with another" in other.output


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("situations", "--split", "train", "--scenarios", 1, "--out", "o", "--searched", 2), "'--searched'"),
        (("situations", "--split", "train", "--scenarios", 1, "--out", "o", "--orders", 1), "'--orders'"),
        (("situations", "--split", "exam", "--scenarios", 1, "--out", "o"), "expected one of train, val, test"),
        (("dialogues", "--situations", "none", "--out", "o"), "expected the index of situations, found No such file"),
        (("dialogues", "--situations", "none", "--out", "o", "--repeats", 0), "'--repeats'"),
        (("dialogues", "--situations", "none", "--out", "o", "--without", "cars"), "'--without'"),
    ],
)
def test_a_mistake_is_one_sentence(
    words: tuple[object, ...], part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = learn(*words)
    assert ended.exit_code == 2 and part in " ".join(ended.output.split()) and "Traceback" not in ended.output


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("{", "expected JSON, found an error"),
        ('{"format": "other"}', "expected the format 'mdrive-sumo situations 1', found 'other'"),
        ('{"format": "mdrive-sumo situations 1", "split": "x"}', "split: expected one of train, val, test, found 'x'"),
        ('{"format": "mdrive-sumo situations 1", "split": "train", "files": []}', "files: expected names of one file"),
        (
            '{"format": "mdrive-sumo situations 1", "split": "train", "files": ["../x"]}',
            "files: expected names of files in the same folder, found '../x'",
        ),
        (
            '{"format": "mdrive-sumo situations 1", "split": "train", "files": ["x"]}',
            "x: expected situations, found No such file",
        ),
    ],
)
def test_a_damaged_collection_is_one_sentence(content: str, part: str, tmp_path: Path) -> None:
    (tmp_path / INDEX_NAME).write_text(content)
    ended = learn("dialogues", "--situations", tmp_path, "--out", tmp_path / "out")
    assert ended.exit_code == 2 and part in " ".join(ended.output.split()), ended.output

"""Places of training scenarios: shared by neighbouring indices, apart by split, and none of any suite."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.local_executor import LocalExecutor

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning import training_places
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE, SPLITS
from mdrive_sumo.learning.training_places import (
    KIND_SHARES,
    PLACE_CHOICES,
    SEED_NAMESPACE,
    draw_training_places,
    find_place,
    open_training_place,
)
from mdrive_sumo.scenario.packaged_suites import list_exact_suites
from mdrive_sumo.worlds.places import PLACE_FILE, PLACE_KINDS

FOLDER = Path("places")


@given(st.sampled_from(SPLITS), st.integers(0, 2**31 - 1), st.integers(0, 10**6))
def test_neighbours_share_a_place_that_no_other_split_has(split: str, seed: int, index: int) -> None:
    place = find_place(split, seed, index, FOLDER)
    first = index - index % SCENARIOS_PER_PLACE
    assert {find_place(split, seed, first + k, FOLDER) for k in range(SCENARIOS_PER_PLACE)} == {place}
    others = [find_place(other, seed, index, FOLDER) for other in SPLITS if other != split]
    others += [find_place(split, seed + 1, index, FOLDER), find_place(split, seed, index + SCENARIOS_PER_PLACE, FOLDER)]
    assert place.place_seed not in {other.place_seed for other in others}


def test_another_split_is_refused() -> None:
    with pytest.raises(InputError, match="split: expected one of train, val, test, found 'trial'"):
        find_place("trial", 0, 0, FOLDER)


def test_places_have_every_kind_fast_roads_and_open_ground() -> None:
    assert set(KIND_SHARES) == set(PLACE_KINDS)
    assert sum(KIND_SHARES.values()) == pytest.approx(1.0)
    limits = {choice.parameters.get("limit_kmh") for choice in PLACE_CHOICES if choice.kind.startswith("motorway")}
    assert limits == {80.0, 100.0, 120.0}  # km/h; 120 are 33 m/s
    open_ground = [choice for choice in PLACE_CHOICES if "open" in choice.parameters.values()]
    assert 0.05 < len(open_ground) / len(PLACE_CHOICES) < 0.2


def test_no_packaged_suite_has_a_place_of_this_namespace() -> None:
    suites = list_exact_suites().values()
    about = [json.loads(path.read_text()) for suite in suites for path in suite.glob(f"networks/*/{PLACE_FILE}")]
    assert len(about) > 100  # three seasons
    assert not any(str(one["seed"]).startswith(SEED_NAMESPACE) for one in about)


@pytest.mark.slow
def test_drawn_places_lie_in_the_folder_and_are_drawn_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_places, "make_executor", LocalExecutor)
    notes: list[str] = []
    draw_training_places("test", 5, SCENARIOS_PER_PLACE + 1, tmp_path, 2, notes.append)
    assert notes == [f"2 places for {SCENARIOS_PER_PLACE + 1} scenarios: {tmp_path}"]
    made = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/*"))}
    assert len(made) >= 6  # three files of each place
    draw_training_places("test", 5, 1, tmp_path, 2, notes.append)
    assert notes[1] == f"1 place for 1 scenario: {tmp_path}"
    open_training_place.cache_clear()
    kinds = [open_training_place(find_place("test", 5, k * SCENARIOS_PER_PLACE, tmp_path)) for k in range(2)]
    assert all(roads.folder.parent == tmp_path and roads.name.startswith(kind) for kind, roads in kinds)
    assert {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/*"))} == made

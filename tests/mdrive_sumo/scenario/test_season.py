"""Names of suites with a season, and what they mean where only season 0 is packaged and where several are."""

import json
from pathlib import Path

import pytest
from testing.season_suites import PARTS, package_seasons, write_season
from testing.worlds import straight_ego, straight_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario import packaged_suites
from mdrive_sumo.scenario.packaged_suites import (
    find_suite_folder,
    list_exact_suites,
    list_packaged_suites,
    list_seasons,
    name_packaged_suite,
)
from mdrive_sumo.scenario.season import (
    BENCHMARK_SUITES,
    SEASON_SUITES,
    check_one_season,
    label_suite,
    read_stored_name,
    write_stored_name,
)
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, load_suite_of_one, save_suite

SCENARIO = straight_scenario(straight_ego("0"))


@pytest.fixture
def seasons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Seasons 0 to 2, packaged."""
    package_seasons(tmp_path / "scenarios", 2, SCENARIO, monkeypatch)
    return tmp_path / "scenarios"


@pytest.mark.parametrize("name", SEASON_SUITES)
def test_season_0_is_what_came_before_seasons(name: str) -> None:
    suite = load_suite(f"{name}@0")
    assert (suite.name, suite.label, suite.season) == (name, f"{name}@0", 0)
    assert "season" not in (suite.folder / "suite.json").read_text()
    assert suite.about.season is None
    if suite.about.checksum:
        assert suite.checksum() == suite.about.checksum


@pytest.mark.slow
def test_a_packaged_season_lies_where_its_name_says() -> None:
    for name, folder in list_exact_suites().items():
        assert load_suite(name).folder == folder
        assert write_stored_name(name) == load_suite(name).name
        assert name_packaged_suite(folder) == name


def test_a_bare_name_means_the_newest_season(seasons: Path) -> None:
    assert [load_suite(name).label for name in BENCHMARK_SUITES] == [f"{name}@2" for name in BENCHMARK_SUITES]
    assert list(list_packaged_suites()) == sorted(BENCHMARK_SUITES)
    assert list(list_seasons("mdrive")) == [0, 1, 2]
    assert find_suite_folder("mdrive@1") == seasons / "season_1" / "mdrive"
    assert [suite.split("@")[1] for suite in list_exact_suites()] == [*"222211110000"]


@pytest.mark.parametrize("season", [0, 1, 2])
def test_parts_are_of_the_season_of_the_whole(seasons: Path, season: int) -> None:
    suite = load_suite(f"mdrive@{season}")
    assert [part.label for part in suite.parts] == [f"{name}@{season}" for name in PARTS]
    assert [scenario.id for scenario in suite] == [f"{name}_{season}" for name in PARTS]
    lone = load_suite_of_one(suite.folder, f"v2xpnp_{season}")
    assert lone.find_folder(f"v2xpnp_{season}") == suite.find_folder(f"v2xpnp_{season}")


def test_the_season_is_part_of_the_checksum(seasons: Path, tmp_path: Path) -> None:
    first = load_suite("interdrive@1")
    assert first.about.checksum
    again = Suite(first.about.model_copy(update={"season": 3, "checksum": ""}), first.folder, first.scenarios)
    assert again.checksum() != first.checksum()


def test_a_folder_may_hold_a_season_with_a_word(tmp_path: Path) -> None:
    suite = write_season(tmp_path, "secret-3f2a", SCENARIO)
    assert (suite.name, suite.label, suite.season) == ("mdrive@secret-3f2a",) * 2 + ("secret-3f2a",)
    assert name_packaged_suite(suite.folder) is None


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mdrive@9", "suite 'mdrive@9': expected one of mdrive@0, mdrive@1, mdrive@2, found another season"),
        ("mdrive@01", "suite 'mdrive@01': expected one of mdrive@0,"),
        ("mdrive@-1", "suite 'mdrive@-1': expected one of mdrive@0,"),
        ("interdrive@secret-a", "a secret one, is named by its folder"),
        ("mdirve@1", "found neither; did you mean 'mdrive@1'?"),
        ("mdrvie", "found neither; did you mean 'mdrive'?"),
        ("mdrive@", "found neither; did you mean 'mdrive"),
        ("@1", "found neither"),
    ],
)
def test_unknown_names_get_one_sentence(seasons: Path, name: str, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        load_suite(name)
    assert sentence in str(refused.value)


def test_a_suite_without_seasons_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packaged_suites, "SEASON_SUITES", BENCHMARK_SUITES)
    with pytest.raises(InputError, match=r"suite 'hard@0': expected 'hard', which has no seasons, found one after @"):
        load_suite("hard@0")


@pytest.mark.parametrize("season", [0, -1, 1.5, True, "", "3", "a b", "x" * 50, "é", "a@b", [1]])
def test_a_season_is_a_number_from_one_or_a_word(tmp_path: Path, season: object) -> None:
    save_suite(Suite(SuiteFile(name="mine", title=""), tmp_path, (SCENARIO.model_copy(update={"id": "a"}),)))
    path = tmp_path / "suite.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "season": season}))
    with pytest.raises(InputError, match=r"suite\.json: season"):
        load_suite(str(tmp_path))


def test_parts_of_another_season_are_refused(tmp_path: Path) -> None:
    write_season(tmp_path, 4, SCENARIO)
    path = tmp_path / "v2xpnp" / "suite.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "season": 5, "checksum": ""}))
    with pytest.raises(InputError, match=r"mdrive/suite\.json: parts: expected suites of season 4, found v2xpnp@5 in"):
        load_suite(str(tmp_path / "mdrive"))


def test_an_own_suite_may_name_the_season_of_its_parts(seasons: Path, tmp_path: Path) -> None:
    about = SuiteFile(name="mine", title="", parts=("interdrive@0", "interaction@1", "v2xpnp"))
    save_suite(Suite(about, tmp_path / "mine", ()))
    assert [part.label for part in load_suite(str(tmp_path / "mine")).parts] == [
        "interdrive@0",
        "interaction@1",
        "v2xpnp@0",
    ]


@pytest.mark.parametrize(
    ("stored", "typed"),
    [
        ("mdrive", "mdrive@0"),
        ("mdrive@2", "mdrive@2"),
        ("hard", "hard@0"),
        ("mine", "mine"),
        ("/my/suite", "/my/suite"),
    ],
)
def test_a_name_in_a_file_without_a_season_is_of_season_0(stored: str, typed: str) -> None:
    assert read_stored_name(stored) == typed
    assert write_stored_name(typed) == stored


def test_people_read_the_season_also_of_season_0() -> None:
    assert label_suite("interaction", None) == "interaction@0"
    assert label_suite("interaction", 2) == "interaction@2"
    assert label_suite("mine", None) == "mine"


def test_runs_of_several_seasons_are_named_with_what_to_do_and_of_several_suites_without() -> None:
    check_one_season("report", {"a": "mdrive@1", "b": "mdrive@1", "c": "mine"}, "--mix")
    with pytest.raises(InputError, match=r"report: expected runs of one season, found mdrive@1 in a .* in b; --mix$"):
        check_one_season("report", {"a": "mdrive@1", "b": "mdrive@2"}, "--mix")
    with pytest.raises(InputError, match=r"one suite and season, found mdrive@1 in a and hard@0 in b$"):
        check_one_season("report", {"a": "mdrive@1", "b": "hard"}, "--mix")

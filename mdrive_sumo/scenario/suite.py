"""Suites: folders of scenarios, packaged with mdrive-sumo or anywhere on disk.

SUITE/suite.json                    name, title, description
SUITE/<scenario id>/scenario.json   one scenario
SUITE/networks/<name>/              networks of the suite's own, if any

A suite may instead name others as its parts in `suite.json`: then it has their scenarios, and no folders of its own.
Suites of a season after the first say which: see `scenario.season`.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast, overload

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.data_frame import build_data_frame
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.scenario.packaged_suites import (
    SUITE_FILE,
    find_packaged_suite,
    find_suite_folder,
    is_own_suite,
    list_exact_suites,
    list_packaged_suites,
    name_packaged_suite,
)
from mdrive_sumo.scenario.scenario import Scenario, load_model, load_scenario, save_scenario
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.season import (
    SEASON_WORD,
    Season,
    get_season,
    join_suite_name,
    label_suite,
    read_stored_name,
    split_suite_name,
)
from mdrive_sumo.scenario.statistics import compute_suite_statistics

if TYPE_CHECKING:
    import pandas as pd

SCENARIO_FILE = "scenario.json"
NETWORKS_FOLDER = "networks"
LOG_FILE = "log.npz"
"""Beside a scenario that was converted from a log: the log as a recording, for open loop; no part of the checksum."""
RECIPE_FILE = "recipe.json"
"""Beside a generated scenario: what it was made from, see `generate.recipe`."""


HARD_BUCKET = "Hard"
"""Bucket of the scenarios in which the time counts."""
ScoreModeName = Literal["mdrive", "interdrive_fixed", "interdrive_asis", "hard"]
"""The values of `scoring.ScoreMode`."""
PartName = Annotated[str, Field(pattern=rf"^[A-Za-z0-9][A-Za-z0-9_.+-]{{0,79}}(@([0-9]{{1,4}}|{SEASON_WORD}))?$")]


class SuiteFile(BaseModel):
    """`suite.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["mdrive-sumo/suite/1"] = "mdrive-sumo/suite/1"
    name: Identifier
    title: str
    description: str = ""
    season: Season | None = Field(default=None, exclude_if=lambda season: season is None)
    """The season: a number for a public one, a word for any other; None: season 0, or a suite without seasons."""
    parts: tuple[PartName, ...] = ()
    """Names of packaged suites, or of folders beside this one, whose scenarios it has instead of any of its own.

    Those of a suite of a season, 0 too, are beside it.
    """
    only: tuple[Identifier, ...] = Field(default=(), exclude_if=lambda only: not only)
    """Ids of the scenarios that it has of its parts; absent: all of them."""
    checksum: str = ""
    """Checksum of the sealed suite, see `Suite.checksum`; "": it may be changed."""
    score_mode: ScoreModeName | None = Field(default=None, exclude_if=lambda mode: mode is None)
    """Score mode of runs that name none; without it see `Suite.score_mode`."""


@dataclass(frozen=True, repr=False)
class Suite:
    """A loaded suite. Scenarios are sorted by id, numbers in it by value (r2 before r10)."""

    about: SuiteFile
    folder: Path
    scenarios: tuple[Scenario, ...]
    parts: tuple["Suite", ...] = ()
    """The suites that it is made of, see `SuiteFile.parts`."""

    def __repr__(self) -> str:
        return f"Suite({self.label!r}, {len(self)} scenarios)"

    def __len__(self) -> int:
        """Number of scenarios."""
        return len(self.scenarios)

    def __iter__(self) -> Iterator[Scenario]:
        """Iterate over the scenarios in the order of the suite."""
        return iter(self.scenarios)

    @overload
    def __getitem__(self, key: int) -> Scenario: ...
    @overload
    def __getitem__(self, key: slice) -> "Suite": ...
    @overload
    def __getitem__(self, key: str) -> "Scenario | Suite": ...
    def __getitem__(self, key: int | slice | str) -> "Scenario | Suite":
        """Return one scenario for an index or an exact id, and a suite of the matching ones for a slice or a glob.

        A glob may match ids or categories; several are separated by commas. Raises InputError if nothing matches.
        """
        if isinstance(key, int):
            return self.scenarios[key]
        if isinstance(key, slice):
            return replace(self, scenarios=self.scenarios[key])
        exact = next((scenario for scenario in self.scenarios if scenario.id == key), None)
        return exact or replace(self, scenarios=self.select(key))

    def to_frame(self) -> "pd.DataFrame":
        """Return one row per scenario, indexed by scenario id. Needs pandas (extra `notebook`)."""
        return build_data_frame(map(_describe_scenario, self.scenarios)).set_index("scenario")

    @property
    def name(self) -> str:
        """Short name, as files hold it: `mdrive@1`; `mdrive` for season 0."""
        return join_suite_name(self.about.name, self.about.season)

    @property
    def label(self) -> str:
        """Short name with any season, as people read and type it: `mdrive@0`, `mdrive@1`, `hard`."""
        return label_suite(self.about.name, self.about.season)

    @property
    def season(self) -> int | str | None:
        """The season: a number for a public one, a word for any other; None: the suite has no seasons."""
        return get_season(self.about.name, self.about.season)

    @property
    def score_mode(self) -> ScoreModeName:
        """Score mode of runs that name none: that of `suite.json`, else `hard` if all scenarios have bucket `Hard`."""
        is_hard = all(scenario.bucket == HARD_BUCKET for scenario in self.scenarios)
        return self.about.score_mode or ("hard" if is_hard else "mdrive")

    def find_folder(self, scenario: str) -> Path:
        """Folder of the suite in which a scenario lies, and beside which its network may lie."""
        return next((part.folder for part in self.parts if any(s.id == scenario for s in part.scenarios)), self.folder)

    def find_scenario_file(self, scenario: str) -> Path:
        """File of a scenario."""
        return self.find_folder(scenario) / scenario / SCENARIO_FILE

    def compute_file_checksum(self, scenario: str) -> str:
        """SHA-256 of a scenario's file as it is now, by which a process that reads it later notices a change."""
        return compute_file_checksum(self.find_scenario_file(scenario))

    def checksum(self) -> str:
        """SHA-256 over the scenarios, order and formatting of the files aside, and over networks of the suite's own."""
        digest = hashlib.sha256(self.name.encode())
        for scenario in self.scenarios:
            digest.update(scenario.model_dump_json().encode())
        for path in sorted(path for home in self._folders() for path in (home / NETWORKS_FOLDER).glob("*/*")):
            digest.update(path.name.encode() + b"\0" + read_bytes(path))
        return "sha256:" + digest.hexdigest()

    def _folders(self) -> tuple[Path, ...]:
        return (self.folder, *(part.folder for part in self.parts))

    def select(self, pattern: str) -> tuple[Scenario, ...]:
        """Return the scenarios whose id or category matches a glob, or one of several globs separated by commas.

        Raises InputError if a glob matches none.
        """
        globs = pattern.split(",")
        for glob in globs:
            if not any(fnmatchcase(name, glob) for s in self.scenarios for name in (s.id, s.category)):
                raise InputError(self._describe_no_match(glob))
        return tuple(s for s in self.scenarios if any(fnmatchcase(n, g) for g in globs for n in (s.id, s.category)))

    def _describe_no_match(self, glob: str) -> str:
        """Return a sentence about a glob without a match, with the nearest name or where the names are listed."""
        names = dict.fromkeys(name for scenario in self.scenarios for name in (scenario.id, scenario.category))
        remedy = suggest_name(glob, names) or f"; `mdrive-sumo list scenarios --suite {self._typed_name()}` lists them"
        return f"suite {self.label}: expected a scenario id or category like {glob!r}, found none{remedy}"

    def _typed_name(self) -> str:
        """Return what `--suite` takes for this suite."""
        return name_packaged_suite(self.folder) or str(self.folder)


def _describe_scenario(scenario: Scenario) -> dict[str, str | int | float]:
    """Return one row of `Suite.to_frame`."""
    statistics = compute_suite_statistics((scenario,))
    return {
        "scenario": scenario.id,
        "bucket": scenario.bucket,
        "category": scenario.category,
        "network": scenario.network,
        "weather": scenario.weather,
        "cavs": statistics.cavs,
        "mean_route_m": statistics.mean_route_m,
        "mean_heading_change_deg": statistics.mean_heading_change_deg,
        "background_vehicles": len(scenario.background.vehicles),
        "scripted_actors": len(scenario.actors),
    }


def load_suite(name_or_folder: str) -> Suite:
    """A packaged suite by name, or any suite by its folder; raises InputError.

    `mdrive@1` is season 1; without a season a name means the newest public one.
    """
    if not isinstance(cast(object, name_or_folder), str | PathLike):
        raise InputError(f"suite: expected the name or the folder of a suite, found {name_or_folder!r:.40}")
    folder = find_suite_folder(str(name_or_folder))
    if not folder.is_dir():
        raise InputError(_describe_unknown_suite(str(name_or_folder)))
    about = _suite_file(folder / SUITE_FILE)
    parts = _parts(about, folder)
    suite = Suite(about, folder, _scenarios_of(parts, about, folder) if parts else _scenarios(folder), parts)
    if about.checksum and about.checksum != suite.checksum():
        raise InputError(
            f"{folder / SUITE_FILE}: checksum: expected scenarios and networks with {about.checksum[:19]}...,"
            f" found {suite.checksum()[:19]}...; they were changed (a suite of your own has no checksum)"
        )
    return suite


def _describe_unknown_suite(name: str) -> str:
    """Return a sentence about a name that is neither a suite nor a folder."""
    packaged = list_packaged_suites()
    suite, season = split_suite_name(name)
    suggestion = suggest_name(name, list_exact_suites() if season else packaged) or suggest_name(suite, packaged)
    return f"suite {name!r}: expected a folder or one of {', '.join(packaged)}, found neither{suggestion}"


def load_suite_of_one(folder: Path, scenario: str) -> Suite:
    """Return the suite in a folder with this scenario only: a worker process needs no others, and `mdrive` takes 35 MB.

    Its checksum is not checked, because that is over all scenarios. Raises InputError.
    """
    about = _suite_file(folder / SUITE_FILE)
    part_folders = [_find_part_folder(name, about, folder) for name in about.parts]
    home = next((one for one in (part_folders or [folder]) if (one / scenario / SCENARIO_FILE).is_file()), None)
    if home is None:
        raise InputError(f"suite {label_suite(about.name, about.season)}: expected a scenario {scenario!r}, found none")
    scenarios = (_scenario(home / scenario / SCENARIO_FILE),)
    parts = (Suite(_suite_file(home / SUITE_FILE), home, scenarios),) if part_folders else ()
    return Suite(about, folder, scenarios, parts)


def seal_suite(suite: Suite) -> Suite:
    """The same suite, of which `suite.json` will hold the checksum."""
    return replace(suite, about=suite.about.model_copy(update={"checksum": suite.checksum()}))


def _scenarios(folder: Path) -> tuple[Scenario, ...]:
    paths = sorted(folder.glob(f"*/{SCENARIO_FILE}"), key=lambda path: natural_sort_key(path.parent.name))
    if not paths:
        raise InputError(f"{folder}: expected scenarios in <id>/{SCENARIO_FILE}, found none")
    return tuple(_scenario(path) for path in paths)


def _parts(about: SuiteFile, folder: Path) -> tuple[Suite, ...]:
    if about.only and not about.parts:
        raise InputError(
            f"{folder / SUITE_FILE}: only: expected none in a suite without parts, found {about.only[0]!r}"
        )
    parts = tuple(load_suite(str(_find_part_folder(name, about, folder))) for name in about.parts)
    if nested := [part.name for part in parts if part.about.parts]:
        raise InputError(f"{folder}: expected parts with scenarios of their own, found {nested[0]!r}, which has parts")
    if about.season is not None and (others := [part for part in parts if part.season != about.season]):
        found = f"found {others[0].label} in {others[0].folder.name}"
        raise InputError(f"{folder / SUITE_FILE}: parts: expected suites of season {about.season}, {found}")
    return parts


def _find_part_folder(name: str, about: SuiteFile, folder: Path) -> Path:
    """Return the folder of a part of the suite in `folder`: a packaged suite, or one beside it.

    The parts of a season are beside it. A packaged name without a season is season 0, as in all files.
    """
    beside = folder.parent / name
    if about.season is not None or is_own_suite(folder):
        return beside
    return find_packaged_suite(read_stored_name(name)) or beside


def _scenarios_of(parts: Sequence[Suite], about: SuiteFile, folder: Path) -> tuple[Scenario, ...]:
    scenarios = tuple(scenario for part in parts for scenario in part.scenarios)
    ids = [scenario.id for scenario in scenarios]
    if twice := sorted({name for name in ids if ids.count(name) > 1}):
        raise InputError(f"{folder}: expected every scenario id once in its parts, found {twice[0]!r} twice")
    if missing := sorted(set(about.only) - set(ids)):
        raise InputError(
            f"{folder / SUITE_FILE}: only: expected ids of scenarios of {', '.join(about.parts) or 'its parts'},"
            f" found {missing[0]!r}{suggest_name(missing[0], ids)}"
        )
    return tuple(scenario for scenario in scenarios if not about.only or scenario.id in about.only)


def save_suite(suite: Suite) -> None:
    """Writes `suite.json` and every scenario into the suite's folder."""
    make_folder(suite.folder)
    write_text(suite.folder / SUITE_FILE, suite.about.model_dump_json(indent=2) + "\n")
    for scenario in suite.scenarios:
        save_scenario(scenario, suite.folder / scenario.id / SCENARIO_FILE)


def _suite_file(path: Path) -> SuiteFile:
    return load_model(path, SuiteFile)


def _scenario(path: Path) -> Scenario:
    scenario = load_scenario(path)
    if scenario.id != path.parent.name:
        raise InputError(f"{path}: id: expected {path.parent.name!r}, the name of its folder, found {scenario.id!r}")
    return scenario


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """Sort key of names with numbers in them, which count by value: r2 before r10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]

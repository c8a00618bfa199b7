"""Seasons: sets of scenarios of one composition, drawn one after the other, and their names `mdrive@0`, `mdrive@1`, ...

Season 0 is older than seasons: its files and results name none. So a name in a file, such as the journal of a run,
means season 0 if it has no season; a name that a user types means the newest public one.
"""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, StrictInt, StringConstraints

from mdrive_sumo.core.errors import InputError

BENCHMARK_SUITES = ("interdrive", "interaction", "v2xpnp", "mdrive")
"""Names of the suites of the benchmark, which every season has; the one that is made of the others is the last."""
SHORT_SUITE = "mdrive-40"
"""Name of the suite of some scenarios of a season that keep the ranking of agents, for quick work."""
SEASON_SUITES = ("hard", *BENCHMARK_SUITES, SHORT_SUITE)
"""Names of all suites with seasons."""
SEASON_SIGN = "@"
"""Between the name of a suite and its season."""
FIRST_SEASON = 0
"""The season of the suites that name none."""
SEASON_REMEDY = "`mdrive-sumo study seasons` compares seasons"
"""What to do with runs of several seasons."""
SEASON_WORD = r"[A-Za-z][A-Za-z0-9_.-]{0,39}"

Season = Annotated[StrictInt, Field(ge=1, le=9999)] | Annotated[str, StringConstraints(pattern=f"^{SEASON_WORD}$")]
"""A number for a public season, a word for any other, such as a secret one. Season 0 is written as None."""


def split_suite_name(name: str) -> tuple[str, str]:
    """Return the name of a suite and the text of its season; "" if it names none."""
    suite, _, season = name.partition(SEASON_SIGN)
    return suite, season


def join_suite_name(name: str, season: int | str | None) -> str:
    """Return what a suite is called in files: `mdrive@1`; of season 0 (None), and of suites without seasons, `mdrive`.

    It is the opposite of `split_suite_name`.
    """
    return name if season is None else f"{name}{SEASON_SIGN}{season}"


def label_suite(name: str, season: int | str | None) -> str:
    """Return what people read and type: as `join_suite_name`, but `mdrive@0` for season 0 of a suite with seasons."""
    return join_suite_name(name, get_season(name, season))


def get_season(name: str, season: int | str | None) -> int | str | None:
    """Return the season of a suite whose file names this one: 0 if it names none; None: it has no seasons."""
    return FIRST_SEASON if season is None and name in SEASON_SUITES else season


def write_stored_name(name: str) -> str:
    """Return what files hold for the exact name of a packaged suite: `mdrive` for `mdrive@0`, others as they are."""
    return name.removesuffix(f"{SEASON_SIGN}{FIRST_SEASON}")


def check_one_season(command: str, suite_by_place: Mapping[str, str], remedy: str) -> None:
    """Raise InputError for suites of different seasons; those without seasons go with all.

    suite_by_place: names of suites as files hold them, by the run or file that has them. remedy: what to do instead.
    """
    seasoned = [(place, name) for place, name in suite_by_place.items() if find_stored_season(name)]
    for place, name in seasoned[1:]:
        if find_stored_season(name) != find_stored_season(seasoned[0][1]):
            first, other = (read_stored_name(one) for one in (seasoned[0][1], name))
            is_one_suite = split_suite_name(first)[0] == split_suite_name(other)[0]
            raise InputError(
                f"{command}: expected runs of one {'season' if is_one_suite else 'suite and season'}, found {first} in"
                f" {seasoned[0][0]} and {other} in {place}{f'; {remedy}' if is_one_suite else ''}"
            )


def find_stored_season(name: str) -> str:
    """Return the season of the name of a suite in a file, as text: "0" if it names none, "" if it has no seasons."""
    return split_suite_name(read_stored_name(name))[1]


def read_stored_name(name: str) -> str:
    """Return what a name or folder of a suite in a file means for `load_suite`: without a season it is season 0."""
    return label_suite(name, None)

"""SeasonSeed: what a season is drawn from, and the seeds of its parts."""

import hashlib
import re
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.recipe import GENERATOR
from mdrive_sumo.scenario.season import SEASON_WORD
from mdrive_sumo.worlds.places import PLACES_VERSION

SEASON_VERSION = 2
"""Raised whenever the same season would become another one. 2: running signals, larger pools, shorter routes."""
SECRET_PREFIX = "secret-"
"""Before the number of a season with a secret, which is none of the public ones."""


@dataclass(frozen=True, slots=True)
class SeasonSeed:
    """Number or word of a season, and its secret; "" for a public one."""

    season: int | str
    secret: str = ""

    def derive(self, *words: object) -> str:
        """Return the seed of a part of the season; the secret cannot be derived from it."""
        return self._hash(12, *words)

    def describe(self) -> dict[str, str | int]:
        """Return what makes two seasons the same, without the secret."""
        versions = {"seasons": SEASON_VERSION, "generator": GENERATOR, "places": PLACES_VERSION}
        return {"season": str(self.season), **versions, "seed": self._hash(16, "season")}

    def _hash(self, size: int, *words: object) -> str:
        parts = (SEASON_VERSION, GENERATOR, PLACES_VERSION, self.season, self.secret, *words)
        return hashlib.blake2b("\x00".join(map(str, parts)).encode(), digest_size=size).hexdigest()


def parse_season(text: str, secret: str = "") -> SeasonSeed:
    """Return the season that a user names: a number; with a secret also a word. Raises InputError."""
    if re.fullmatch(r"[0-9]{1,4}", text):
        number = int(text)
        if number == 0:
            raise InputError(
                "--season 0: expected a number from 1 to 9999, found that of the packaged suites, which were drawn"
                " before there were seasons: `mdrive-sumo list suites` names them"
            )
        return SeasonSeed(f"{SECRET_PREFIX}{number}" if secret else number, secret)
    if not re.fullmatch(SEASON_WORD, text):
        raise InputError(
            f"--season: expected a number from 1 to 9999, or with --secret a word of letters, digits and _.-,"
            f" found {text!r:.60}"
        )
    if not secret:
        raise InputError(f"--season {text}: expected a number, found a word, which needs --secret")
    return SeasonSeed(text, secret)

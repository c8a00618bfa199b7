"""Short episodes at random, and the bits of what their CAVs saw and planned, tick by tick.

python -m testing.random_episodes COUNT     # prints a JSON list; the environment says whether the layer is used
"""

import json
import random
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mdrive_sumo
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from testing.short_suite import shorten
from tools.compare_platforms import note_bits

AGENTS = ("constant-speed", "idm", "single", "sharing", "sharing+negotiation", "omniscient", "take-turns")
CHANNELS: tuple[Literal["ideal", "realistic"], ...] = ("ideal", "realistic")
METRES = 12
"""Of each route."""


@dataclass(frozen=True)
class ShortEpisode:
    """What is driven."""

    suite: Suite
    scenario: Scenario
    agent: str
    channel: Literal["ideal", "realistic"]
    seed: int

    def drive(self) -> list[int]:
        """Return a checksum of each observation and plan, in their order, and one of the recording."""
        sums: list[int] = []
        agent = note_bits(self.agent, lambda bits: sums.append(zlib.crc32(bits)))
        scenario = shorten(self.scenario, METRES)
        episode = mdrive_sumo.simulate(scenario, agent, suite=self.suite, seed=self.seed, comm=self.channel)
        return [*sums, zlib.crc32(episode.digest.encode())]

    def __str__(self) -> str:
        return f"{self.scenario.id} {self.agent} {self.channel} {self.seed}"


def draw_episodes(count: int) -> Iterator[ShortEpisode]:
    """Return the same episodes in every process: scenarios of all suites, with replacement."""
    chance = random.Random(1)  # the first episodes are short, of five agents: `make test` drives six
    known = [(suite, scenario) for suite in map(load_suite, ("mdrive", "hard@0")) for scenario in suite.scenarios]
    for _ in range(count):
        suite, scenario = chance.choice(known)
        yield ShortEpisode(suite, scenario, chance.choice(AGENTS), chance.choice(CHANNELS), chance.randrange(4))


def main() -> None:
    """Drive them."""
    json.dump([[str(episode), episode.drive()] for episode in draw_episodes(int(sys.argv[1]))], sys.stdout)


if __name__ == "__main__":
    main()

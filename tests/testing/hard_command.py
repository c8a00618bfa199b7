"""`mdrive-sumo generate --hard` in the process of a test, with the toy as its only family. No tests in here."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import generate_hard, main
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.generate.hard import (
    candidate_evaluation,
    candidate_probes,
    families,
    hard_selection,
    reference_drive,
)
from mdrive_sumo.generate.hard.candidate_probes import PROBES
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from testing.local_executor import run_in_process
from testing.toy_family import TOY, TOY_FAMILY


def use_toy_family(patch: pytest.MonkeyPatch) -> None:
    """Search the toy in this process; a car that stands stands in for all probed agents, because it is cheap.

    It drives once a scenario and seed: what it may sense changes nothing.
    """
    run_in_process(patch)
    patch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY})
    cheap = tuple(replace(probe, agent="stationary") for probe in PROBES)
    patch.setattr(candidate_evaluation, "BLIND_AGENT", "stationary")
    patch.setattr(candidate_probes, "PROBES", cheap)
    patch.setattr(candidate_probes, "drive_with", _drive_once())
    patch.setattr(generate_hard, "KNOWN_SUITES", ("interdrive",))
    patch.setattr(hard_selection, "CHECK_SEEDS", 2)


def _drive_once() -> Callable[..., EpisodeRecord]:
    """Return `drive_with` that keeps what it drove."""
    driven: dict[tuple[str, str, int], EpisodeRecord] = {}

    def drive(agent: str, scenario: Scenario, roads: RoadMap, seed: int, options: EpisodeOptions) -> EpisodeRecord:
        key = agent, scenario.model_dump_json(), seed
        if key not in driven:
            driven[key] = reference_drive.drive_with(agent, scenario, roads, seed, options)
        return driven[key]

    return drive


def run_command(*arguments: object) -> Result:
    """Run `mdrive-sumo` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def read_contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder by relative path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

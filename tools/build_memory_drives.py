"""Write the drives that the agent `memory` repeats: those of `omniscient` on season 0 with seed 0.

    mdrive-sumo eval --suite mdrive@0 --agent omniscient --seed 0 --out RUN
    python -m tools.build_memory_drives RUN [--dry-run]

It writes `mdrive_sumo/agents/memory_drives.npz` and its checksum in `mdrive_sumo/agents/memory.py`.
"""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

from mdrive_sumo.agents import memory
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from tools.tool_command import HELP, ToolCommand, dry_run_option

AGENT, SUITE = "omniscient", "mdrive@0"
SOURCE = Path(memory.__file__)
SAMPLE_TICKS = round(memory.SAMPLE_S / DT)


def check_run(run: StoredRun) -> None:
    """Raise InputError unless a run is that of `omniscient` on all of season 0 with seed 0."""
    info = run.results.run
    found = (info.agent, info.suite_label, info.all_seeds, len(run.results.scenarios))
    expected = (AGENT, SUITE, (0,), len(run.run.suite))
    if found != expected:
        raise InputError(f"expected a run of agent, suite, seeds, scenarios {expected}, found {found}")


def sample_drives(scenario: Scenario, episode: EpisodeRecord) -> Iterator[tuple[Float, float, Float]]:
    """Yield goal (2,) [m], time limit [s] and points (N, 2) [m] of the drive of each CAV."""
    limits = compute_time_limit_ticks(scenario)
    for column, ego in enumerate(scenario.egos):
        last = episode.find_ending(ego.id).tick
        ticks = np.arange(0, last + 1, SAMPLE_TICKS)
        points = np.stack([episode.x[ticks, column], episode.y[ticks, column]], axis=1)
        yield ego.xy[-1], limits[ego.id] * DT, points


def build_drives(run: StoredRun) -> bytes:
    """Return the content of the file of drives of a run. Raises InputError for a missing recording."""
    sampled = [
        drive
        for scenario in run.run.scenarios
        for drive in sample_drives(scenario, load_episode(run.run.find_recording((scenario.id, 0))))
    ]
    goals, limits, drives = zip(*sampled, strict=True)
    return memory.pack_drives(np.array(goals), np.array(limits), list(drives))


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@dry_run_option
def main(folder: Path, dry_run: bool) -> None:
    """Write the drives of a run of `omniscient` on season 0 for the agent `memory`."""
    run = load_stored_run(folder)
    check_run(run)
    content = build_drives(run)
    checksum = hashlib.sha256(content).hexdigest()
    if not dry_run:
        write_bytes(memory.DRIVES_FILE, content)
        text = re.sub(r'(?m)^DRIVES_CHECKSUM = "[0-9a-f]*"', f'DRIVES_CHECKSUM = "{checksum}"', SOURCE.read_text())
        write_text(SOURCE, text)
    verb = "would write" if dry_run else "wrote"
    echo(f"{verb} {memory.DRIVES_FILE.name}: {len(content)} bytes, SHA-256 {checksum}")


if __name__ == "__main__":
    main()

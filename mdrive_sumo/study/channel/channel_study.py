"""Measures of runs that were recorded: one `RunMeasures` for each run folder."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.export.export_run import load_recordings, select_recorded
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.study.channel.awareness import AwarenessCounts
from mdrive_sumo.study.channel.channel_load import ChannelLoads
from mdrive_sumo.study.channel.link_measures import LinkCounts
from mdrive_sumo.v2x.channel import NOT_TRANSMITTED


@dataclass
class RunMeasures:
    """What the channel of a run did, over all its episodes."""

    name: str
    """Agent and channel; with the folder where two runs have the same."""
    folder: Path
    stored: StoredRun
    episodes: int = 0
    links: LinkCounts = field(default_factory=LinkCounts)
    awareness: AwarenessCounts = field(default_factory=AwarenessCounts)
    loads: ChannelLoads = field(default_factory=ChannelLoads)


def measure_runs(
    runs: Sequence[tuple[Path, StoredRun]], patterns: Sequence[str], announce: Callable[[str], None]
) -> list[RunMeasures]:
    """Return the measures of every run. patterns: scenarios to take, none for all; announce: is told what is done.

    Raises InputError for a run given twice, without recordings, or whose stations transmitted nothing.
    """
    places = [folder.resolve() for folder, _ in runs]
    if len(set(places)) < len(places):
        twice = next(folder for folder, _ in runs if places.count(folder.resolve()) > 1)
        raise InputError(f"study channel: expected different runs, found {twice} twice")
    chosen = [select_recorded(stored, patterns) for _, stored in runs]
    measured: list[RunMeasures] = []
    for name, (folder, stored), results in zip(_name_runs(runs), runs, chosen, strict=True):
        measures = RunMeasures(name, folder, stored)
        for recording in load_recordings(stored, results):
            measures.links.add(recording.record, recording.scenario)
            measures.awareness.add(recording.record, recording.roads)
            measures.loads.add(recording.record.busy_ratios)
            measures.episodes += 1
            announce(f"{name}: {recording.name}")
        _check_transmitted(measures)
        measured.append(measures)
    return measured


def _name_runs(runs: Sequence[tuple[Path, StoredRun]]) -> list[str]:
    names = [f"{stored.results.run.agent}, {stored.results.run.comm.get('preset', 'ideal')}" for _, stored in runs]
    return [
        f"{name} ({folder.name})" if names.count(name) > 1 else name
        for name, (folder, _) in zip(names, runs, strict=True)
    ]


def _check_transmitted(measures: RunMeasures) -> None:
    counts: Counter[str] = Counter()
    for (_, status), count in measures.links.statuses.items():
        counts[status] += count
    if set(counts) <= NOT_TRANSMITTED:
        found = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
        raise InputError(
            f"{measures.folder}: expected at least one message that was transmitted to another station, found"
            f" {found or 'no message between stations'}"
        )

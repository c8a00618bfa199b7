"""`mdrive-sumo learn scans`."""

import time
from pathlib import Path

import click

from mdrive_sumo.agents.learned.fusion_spec import MAX_CAVS
from mdrive_sumo.cli.learn_data import collection_options, exit_after_collection, run_collection
from mdrive_sumo.cli.options import FiniteRange
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.fusion.drive_frames import SCAN_TICKS, FrameSampling
from mdrive_sumo.learning.fusion.frame_collection import FrameSet, collect_frames
from mdrive_sumo.learning.sample_format import PLACES_FOLDER, CollectedScenario, ShardEntry

EXPERT = "sharing+negotiation"
"""It drives by what CAVs see and share, as agents with these detectors do."""


@click.command("scans")
@collection_options(EXPERT)
@click.option(
    "--interval-s",
    type=FiniteRange(0.5, 60.0),
    default=2.0,
    show_default=True,
    help="Between two ticks with frames, to the nearest 0.1 s.",
)
@click.option(
    "--least-cavs",
    type=click.IntRange(2, 6),
    default=2,
    show_default=True,
    help="Scenarios with fewer CAVs are not driven.",
)
@click.option(
    "--least-others",
    type=click.IntRange(0, 100),
    default=0,
    show_default=True,
    help="Scenarios with fewer other road users are not driven.",
)
def command(
    split: str,
    scenarios: int,
    expert: str,
    out: Path,
    workers: int,
    seed: int,
    places: Path | None,
    fresh: bool,
    suite: str,
    interval_s: float,
    least_cavs: int,
    least_others: int,
) -> None:
    """Make frames for detectors that share features: LiDAR scans of CAVs and their senders, poses, and true boxes.

    The same command continues after an interruption; a larger --scenarios extends the data set.
    """
    folder = (places or out.parent / PLACES_FOLDER).resolve()
    settings = CollectionSettings(split, seed, expert, perturbation=0.0, suite=suite, places=folder)
    sampling = FrameSampling(SCAN_TICKS * round(interval_s * TICKS_PER_SECOND / SCAN_TICKS), least_cavs, least_others)
    found = run_collection(
        out,
        fresh,
        lambda: collect_frames(settings, sampling, out, scenarios, workers, ScenarioDisplay("frames"), fresh),
    )
    echo(format_frames(found))
    echo(f"{out}  {sum(one.samples > 0 for one in found.scenarios)} archives and frames.json")
    exit_after_collection(found.scenarios, scenarios)


def format_frames(found: FrameSet) -> str:
    """Return a table of what a data set holds, and one of senders."""
    counts = {status: sum(one.status == status for one in found.scenarios) for status in ("done", "none", "failed")}
    row = (
        *map(str, counts.values()),
        str(sum(one.ticks for one in found.scenarios)),
        str(sum(one.samples for one in found.scenarios)),
        str(sum(one.dropped for one in found.scenarios)),
        f"{sum(archive.bytes for archive in found.archives) / 1e6:.1f}",
    )
    totals = make_text_table(("scenarios", "not driven", "failed", "CAV ticks", "frames", "left out", "MB"), [row])
    senders = [str(sum(archive.senders[i] for archive in found.archives)) for i in range(MAX_CAVS - 1)]
    table = make_text_table(("senders", *map(str, range(1, MAX_CAVS))), [("frames", *senders)])
    return f"{format_text(totals)}\n{format_text(table)}"


class ScenarioDisplay:
    """Progress on standard error: one line per scenario."""

    def __init__(self, noun: str) -> None:
        """noun: what a scenario gives, in the plural."""
        self._noun = noun
        self._total = self._done = self._frames = 0
        self._began = time.monotonic()

    def begin(self, total: int, kept: int, waiting: int = 0) -> None:
        """See CollectionProgress."""
        del waiting
        self._total, self._done = total, kept
        self._began = time.monotonic()
        if kept:
            self.note(f"continuing: {kept} of {total} scenarios are there")

    def finish_scenario(self, scenario: CollectedScenario) -> None:
        """See CollectionProgress."""
        self._done += 1
        self._frames += scenario.samples
        rate = self._frames / max(time.monotonic() - self._began, 1e-3)
        name = f"scenario {scenario.index}"
        self.note(f"{self._done}/{self._total}  {name}: {scenario.samples} {self._noun}; {rate:.1f} {self._noun}/s")

    def finish_shard(self, entry: ShardEntry) -> None:
        """See CollectionProgress: every scenario has an archive of its own."""

    def note(self, text: str) -> None:
        """See CollectionProgress."""
        echo(text, err=True)

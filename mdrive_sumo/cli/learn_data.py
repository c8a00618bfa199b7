"""`mdrive-sumo learn data`."""

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import click

from mdrive_sumo.cli.options import FiniteRange, workers_option
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.collection import collect_dataset
from mdrive_sumo.learning.collection_settings import EXPERTS, CollectionSettings
from mdrive_sumo.learning.recorded_rigs import RIG_NAMES, parse_rig_names
from mdrive_sumo.learning.sample_format import PLACES_FOLDER, SPLITS, CollectedScenario, DatasetFile, ShardEntry

Result = TypeVar("Result")
Decorated = TypeVar("Decorated", bound=Callable[..., Any])
FOLDER = click.Path(path_type=Path, file_okay=False)
EXPERT_HELP = "What drives, or gives the labels."
PLACES_HELP = "Places of the scenarios; what is missing is drawn.  [default: places, beside --out]"


def collection_options(expert: str | None) -> Callable[[Decorated], Decorated]:
    """Return the options of commands that drive training scenarios.

    expert: the default of `--expert`; None: there is no choice.
    """
    number = click.IntRange(1, 1_000_000)
    options = (
        click.option(
            "--split", type=click.Choice(SPLITS), required=True, help="Places for training, validation, test."
        ),
        click.option("--scenarios", type=number, required=True, metavar="N", help="How many scenarios."),
        *_expert_option(expert),
        click.option("--out", type=FOLDER, required=True, help="Folder of the data set."),
        workers_option,
        click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True, help="Of all draws."),
        click.option("--places", type=FOLDER, help=PLACES_HELP),
        click.option("--fresh", is_flag=True, help="Start anew instead of continuing."),
        click.option("--suite", default="", hidden=True, help="Tests: a suite instead of training scenarios."),
    )

    def decorate(command: Decorated) -> Decorated:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def _expert_option(expert: str | None) -> tuple[Callable[[Any], Any], ...]:
    if expert is None:
        return ()
    return (click.option("--expert", type=click.Choice(EXPERTS), default=expert, show_default=True, help=EXPERT_HELP),)


def run_collection(out: Path, fresh: bool, collect: Callable[[], Result]) -> Result:
    """Return what `collect` returns; after Ctrl-C say how the collection continues, and exit."""
    try:
        return collect()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not swallow the answer to the first
        again = "the same command" + (" without --fresh" if fresh else "")
        echo(f"interrupted; {again} continues {out}", err=True)
        click.get_current_context().exit(130)


def exit_after_collection(scenarios: Sequence[CollectedScenario], requested: int) -> NoReturn:
    """Say which scenarios failed, and exit with 0 if all that were requested are done."""
    failed = [scenario for scenario in scenarios if scenario.status == "failed"]
    for scenario in failed:
        name = f" ({scenario.scenario})" if scenario.scenario else ""
        echo(f"scenario {scenario.index}{name} failed: {scenario.reason}", err=True)
    click.get_current_context().exit(1 if failed or len(scenarios) < requested else 0)


perturb_option = click.option(
    "--perturb",
    type=FiniteRange(0.0, 10.0),
    default=1.0,
    show_default=True,
    help="Rate of perturbations of the expert's driving; 1: one every 4 to 8 s, 0: none.",
)


@click.command("data")
@collection_options(EXPERTS[0])
@click.option("--rig", "rigs", multiple=True, metavar="|".join(RIG_NAMES), help="Cameras to record; may repeat.")
@perturb_option
@click.option(
    "--share",
    type=FiniteRange(0.02, 1.0),
    default=1.0,
    show_default=True,
    help="Share of the decisions to keep, in turns of 3 s: more scenarios for as many images.",
)
@click.option(
    "--driver",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="WEIGHTS.onnx",
    help="DAgger: this learner drives, the expert is asked about its states.",
)
@click.option(
    "--mix", type=FiniteRange(0.0, 1.0), default=0.2, show_default=True, help="DAgger: share the expert drives."
)
@click.option(
    "--round",
    "round_",
    type=click.IntRange(0, 1000),
    help="DAgger: number of the round.  [default: 1; 0 without --driver]",
)
def command(out: Path, scenarios: int, workers: int, fresh: bool, **options: Any) -> None:
    """Make training data: drive training scenarios with an expert and keep what a learner sees, with the answers.

    The same command continues after an interruption; a larger --scenarios extends the data set.
    """
    settings = _parse_settings(options, (options["places"] or out.parent / PLACES_FOLDER).resolve())
    display = CollectionDisplay()
    dataset = run_collection(out, fresh, lambda: collect_dataset(settings, out, scenarios, workers, display, fresh))
    echo(format_dataset(dataset))
    echo(f"{out}  {len(dataset.shards)} shards and dataset.json")
    exit_after_collection(_list_scenarios(dataset), scenarios)


def _parse_settings(options: Mapping[str, Any], places: Path) -> CollectionSettings:
    """Return the settings, with a folder of places. Raises InputError and click.UsageError."""
    source = click.get_current_context().get_parameter_source
    driver, round_ = options["driver"], options["round_"]
    if driver is None and (round_ or source("mix") is click.core.ParameterSource.COMMANDLINE):
        raise click.UsageError("--mix and --round go only with --driver: without it the expert drives")
    if driver is not None and round_ == 0:
        raise click.UsageError("--round: expected 1 or more with --driver, found 0, which is the expert's drive")
    return CollectionSettings(
        split=options["split"],
        seed=options["seed"],
        expert=options["expert"],
        rigs=parse_rig_names(options["rigs"]),
        perturbation=options["perturb"],
        driver=None if driver is None else driver.resolve(),
        mix=0.0 if driver is None else options["mix"],
        round=0 if driver is None else round_ or 1,
        share=options["share"],
        suite=options["suite"],
        places=places,
    )


def _list_scenarios(dataset: DatasetFile) -> list[CollectedScenario]:
    return [scenario for shard in dataset.shards for scenario in shard.scenarios]


def format_dataset(dataset: DatasetFile) -> str:
    """Return a table of what a data set holds."""
    scenarios = _list_scenarios(dataset)
    counts = {status: sum(one.status == status for one in scenarios) for status in ("done", "none", "failed")}
    megabytes = sum(shard.bytes for shard in dataset.shards) / 1e6
    header = ("scenarios", "none", "failed", "CAV ticks", "samples", "left out", "MB")
    row = (
        *map(str, counts.values()),
        str(sum(one.ticks for one in scenarios)),
        str(dataset.samples),
        str(sum(one.dropped for one in scenarios)),
        f"{megabytes:.1f}",
    )
    return format_text(make_text_table(header, [row]))


class CollectionDisplay:
    """Progress on standard error: one line per shard."""

    def __init__(self) -> None:
        self._total = self._done = self._samples = 0
        self._began = time.monotonic()

    def begin(self, total: int, kept: int, waiting: int = 0) -> None:
        """See CollectionProgress."""
        self._total, self._done = total, kept
        self._began = time.monotonic()
        if kept or waiting:
            self.note(f"continuing: {kept} of {total} shards and {waiting} scenarios of others are there")

    def finish_scenario(self, scenario: CollectedScenario) -> None:
        """See CollectionProgress."""
        self._samples += scenario.samples

    def finish_shard(self, entry: ShardEntry) -> None:
        """See CollectionProgress."""
        self._done += 1
        rate = self._samples / max(time.monotonic() - self._began, 1e-3)
        self.note(f"{self._done}/{self._total}  {entry.name}: {entry.samples} samples; {rate:.1f} samples/s")

    def note(self, text: str) -> None:
        """See CollectionProgress."""
        echo(text, err=True)

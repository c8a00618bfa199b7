"""`mdrive-sumo learn situations` and `learn dialogues`: what the negotiator's language model is trained on."""

from collections.abc import Sequence
from pathlib import Path

import click

from mdrive_sumo.cli.learn_data import FOLDER, collection_options, exit_after_collection, perturb_option, run_collection
from mdrive_sumo.cli.learn_scans import ScenarioDisplay
from mdrive_sumo.cli.options import FiniteRange, workers_option
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.dialogue.dialogue_collection import TWINS, DialogueSettings, collect_dialogues
from mdrive_sumo.learning.dialogue.drive_situations import SituationSampling
from mdrive_sumo.learning.dialogue.situation_collection import SituationFile, collect_situations
from mdrive_sumo.learning.sample_format import PLACES_FOLDER
from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS


@click.command("situations")
@collection_options(None)
@perturb_option
@click.option(
    "--searched",
    type=FiniteRange(0.0, 1.0),
    default=0.35,
    show_default=True,
    help="Share of the situations whose orders of passing are simulated.",
)
@click.option(
    "--orders", type=click.IntRange(2, 40), default=6, show_default=True, help="Orders that are simulated at most."
)
@click.option("--no-omniscient", is_flag=True, help="Do not ask `omniscient` for its order.")
def situations_command(
    split: str,
    scenarios: int,
    out: Path,
    workers: int,
    seed: int,
    places: Path | None,
    fresh: bool,
    suite: str,
    perturb: float,
    searched: float,
    orders: int,
    no_omniscient: bool,
) -> None:
    """Collect situations of CAVs in conflict: what each of them knows, orders of passing, and how these turn out.

    The same command continues after an interruption; a larger --scenarios extends the collection.
    """
    folder = (places or out.parent / PLACES_FOLDER).resolve()
    settings = CollectionSettings(split, seed, "sharing+negotiation", perturbation=perturb, suite=suite, places=folder)
    sampling = SituationSampling(searched=searched, most_orders=orders, asks_omniscient=not no_omniscient)
    display = ScenarioDisplay("situations")
    found = run_collection(
        out, fresh, lambda: collect_situations(settings, sampling, out, scenarios, workers, display, fresh)
    )
    echo(format_situations(found))
    echo(f"{out}  `learn dialogues --situations {out} --out DIR` writes dialogues about them")
    exit_after_collection([entry.scenario for entry in found], scenarios)


def format_situations(found: Sequence[SituationFile]) -> str:
    """Return a table of what a collection holds."""
    counts = [str(sum(one.scenario.status == status for one in found)) for status in ("done", "none", "failed")]
    total = str(sum(one.scenario.samples for one in found))
    searched, better = sum(one.searched for one in found), sum(one.better for one in found)
    sizes = [str(sum(one.members[i] for one in found)) for i in range(MAX_MEMBERS - 1)]
    header = ("scenarios", "not driven", "failed", "situations", "searched", "other order", "MB")
    row = (*counts, total, str(searched), str(better), f"{sum(one.bytes for one in found) / 1e6:.2f}")
    members = make_text_table(("members", *map(str, range(2, MAX_MEMBERS + 1))), [("situations", *sizes)])
    return f"{format_text(make_text_table(header, [row]))}\n{format_text(members)}"


@click.command("dialogues")
@click.option(
    "--situations", type=FOLDER, multiple=True, required=True, help="Folder of `learn situations`; may repeat."
)
@click.option("--out", type=FOLDER, required=True, help="Folder of the dialogues; earlier ones there are replaced.")
@click.option(
    "--repeats",
    type=click.IntRange(1, 10_000),
    default=12,
    show_default=True,
    help="Conversations about each situation.",
)
@click.option("--without", type=click.Choice(TWINS), help="Leave that out, for a twin of the model.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True, help="Of all draws.")
@workers_option
def dialogues_command(
    situations: tuple[Path, ...], out: Path, repeats: int, without: str | None, seed: int, workers: int
) -> None:
    """Write the dialogues that `learn train-negotiator` reads, and pairs of answers of which one drives better."""
    settings = DialogueSettings(seed, repeats, without or "")
    written = collect_dialogues(settings, situations, out, workers, lambda text: echo(text, err=True))
    echo(
        f"{out}  {written.dialogues} dialogues and {written.pairs} pairs about {written.situations} situations;"
        f" `learn train-negotiator --data {out} --val DIR --out DIR` trains on them"
    )

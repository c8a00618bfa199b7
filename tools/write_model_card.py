"""Write the model cards of learned systems and detectors: docs/models/NAME.md, from what was measured.

    python -m tools.write_model_card NAME [--open-loop FILE] [--run CONDITION=RUN]... [--train COMMAND]...
        [--note TEXT]... [--dry-run]

NAME is a system, `detectors` (all but that of `codriving`) or `codriving`. FILE is what `mdrive-sumo learn evaluate
--out` wrote, of systems only; precisions of detectors come from docs/results/values/detectors.json. RUN is a folder of
`mdrive-sumo eval` with an agent of the card, several of one condition are its seeds. Each option replaces its part of
docs/models/NAME.json, from which, and from the manifests of the packaged weights, the card is written. Without
arguments all cards are written again; a test compares.
"""

import json
import tempfile
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, TRAINED
from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_manifest import read_manifest
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.statistics import bootstrap_nested
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary
from mdrive_sumo.learning.fusion.detectors_file import read_detectors
from mdrive_sumo.scoring import Results, compute_overall, load_results
from mdrive_sumo.study.paper.paper_study import DETECTOR_PREFIX, is_surrogate
from tools.model_card_text import DETECTORS, TEST_SETS, format_card, format_detector_card
from tools.published_values import VALUES_FOLDER
from tools.seed_runs import check_seed_runs
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "models"
FAILURES = 8
"""Kinds of infractions that a card lists, the most frequent first."""
CARD_DETECTORS: Mapping[str, tuple[str, ...]] = {
    DETECTORS: tuple(name for name in TRAINED if name != CODRIVING),
    CODRIVING: (CODRIVING,),
}
"""Cards of weights that share features, and whose weights each describes."""
CARDS = (*SYSTEMS, *CARD_DETECTORS)


def summarise_runs(runs: Sequence[Results]) -> dict[str, Any]:
    """Return scores of the runs of one condition, one a seed, with the 95 % interval of DS, and the failures.

    Raises InputError for runs that do not belong together, and for scenarios without a score.
    """
    check_seed_runs(runs)
    if void := sum(results.void for results in runs):
        raise InputError(f"agent {runs[0].run.agent}: expected a score of every scenario, found {void} without")
    scenarios = [scenario for results in runs for scenario in results.scenarios]
    means = compute_overall(scenarios).bucket_mean
    interval = bootstrap_nested(
        [one.ds for one in scenarios], [one.label for one in scenarios], [one.bucket for one in scenarios]
    )
    kinds = Counter(event.kind for scenario in scenarios for ego in scenario.egos for event in ego.infractions)
    return {
        "suite": runs[0].run.suite,
        "seeds": sorted(seed for results in runs for seed in results.run.all_seeds),
        "episodes": len(scenarios),
        "ds": round(means.ds, 2),
        "ds_interval": [round(end, 2) for end in interval.ends or ()],
        "rc": round(means.rc, 2),
        "sr": round(means.sr, 2),
        "infractions": dict(kinds.most_common(FAILURES)),
        "worst": [one.id for one in sorted(scenarios, key=lambda one: one.ds)[:FAILURES]],
    }


@dataclass(frozen=True, slots=True)
class NewMeasurements:
    """What replaces parts of a system's file of measurements; an empty part leaves what is stored."""

    open_loop: Path | None = None
    """File that `mdrive-sumo learn evaluate --out` wrote."""
    runs: Sequence[str] = ()
    """Each CONDITION=FOLDER of a run; several of one condition are its seeds."""
    commands: Sequence[str] = ()
    """How the weights were trained, in order."""
    notes: Sequence[str] = ()


def update_measured(card: str, new: NewMeasurements) -> dict[str, Any]:
    """Return what is stored for a card with the new measurements. Raises InputError.

    Measurements of other weights than those of a new open loop are dropped.
    """
    path = FOLDER / f"{card}.json"
    measured: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    if new.open_loop is not None:
        if card not in SYSTEMS:
            raise InputError(f"--open-loop: expected one of {', '.join(SYSTEMS)}, found {card}, which has none")
        opened = json.loads(new.open_loop.read_text("utf-8"))
        if (found := opened["system"]) != card:
            raise InputError(f"{new.open_loop}: expected a measurement of {card}, found one of {found}")
        if measured.get("open_loop", opened)["sha256"] != opened["sha256"]:
            measured = {}
        measured["open_loop"] = opened
    for condition, found in _load_runs(card, new.runs).items():
        measured.setdefault("closed_loop", {})[condition] = summarise_runs(found)
    if new.commands:
        measured["commands"] = list(new.commands)
    if new.notes:
        measured["notes"] = list(new.notes)
    return measured


def _load_runs(card: str, texts: Sequence[str]) -> Mapping[str, Sequence[Results]]:
    """Return runs by condition, of texts CONDITION=FOLDER. Raises InputError for those of another card."""
    runs: dict[str, list[Results]] = defaultdict(list)
    for text in texts:
        condition, equals, folder = text.partition("=")
        if not equals:
            raise InputError(f"--run: expected CONDITION=RUN, found {text!r}")
        runs[condition].append(results := load_results(Path(folder) / "results.json"))
        if not _is_of_card(card, results.run.agent):
            raise InputError(f"{folder}: expected a run of {card}, found one of {results.run.agent}")
    return runs


def _is_of_card(card: str, agent: str) -> bool:
    """Return whether an agent drives with weights that a card describes."""
    if card == DETECTORS:
        return agent.startswith(DETECTOR_PREFIX) and not is_surrogate(agent)
    return agent == card if card in SYSTEMS else agent.partition(":")[0] == card


def list_cards() -> list[str]:
    """Return the cards that have a file of measurements."""
    return [card for card in CARDS if (FOLDER / f"{card}.json").is_file()]


def load_measured(card: str) -> dict[str, Any]:
    """Return what is stored for a card."""
    return json.loads((FOLDER / f"{card}.json").read_text("utf-8"))


def build_card(card: str, measured: Mapping[str, Any]) -> str:
    """Return a card. Raises InputError for measurements of other weights than the packaged ones."""
    if card in CARD_DETECTORS:
        return _build_detector_card(card, measured)
    manifest = read_manifest(WEIGHTS_FOLDER / f"{card}.json", WeightsManifest)
    if (found := measured["open_loop"]["sha256"]) != manifest.sha256:
        raise InputError(
            f"{card}: expected measurements of the packaged weights {manifest.sha256:.16}..., found those of"
            f" {found:.16}...; measure them anew"
        )
    return format_card(card, measured, manifest)


def _build_detector_card(card: str, measured: Mapping[str, Any]) -> str:
    manifests = {
        name: (
            read_manifest(WEIGHTS_FOLDER / f"{name}-encoder.json", WeightsManifest),
            read_manifest(WEIGHTS_FOLDER / f"{name}.json", WeightsManifest),
        )
        for name in CARD_DETECTORS[card]
    }
    precisions: dict[str, DetectorSummary] = {}
    for file in TEST_SETS if card == DETECTORS else ():
        path = VALUES_FOLDER / f"{file}.json"
        if not path.is_file():
            continue
        precisions[file] = summary = read_detectors(path)
        for name, (_, manifest) in manifests.items():
            if name in summary.about and summary.about[name].get("training") != manifest.training:
                raise InputError(f"{path}: {name}: expected figures of the packaged weights, found those of others")
    return format_detector_card(card, measured, manifests, precisions)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("card", required=False, metavar="[NAME]", type=click.Choice(CARDS))
@click.option("--open-loop", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="A new measurement.")
@click.option("--run", "runs", multiple=True, metavar="CONDITION=RUN", help="A run folder; may be repeated.")
@click.option(
    "--train", "commands", multiple=True, metavar="COMMAND", help="One of the commands of training, in order."
)
@click.option("--note", "notes", multiple=True, metavar="TEXT", help="A line of the card; may be repeated.")
@dry_run_option
def main(card: str | None, *, dry_run: bool, **new: Any) -> None:
    """Write the card NAME with new measurements, or all cards from what is stored."""
    if card is None and any(new.values()):
        raise InputError("expected the NAME of a card with these options, found none")
    with tempfile.TemporaryDirectory() as scratch:
        for name in [card] if card else list_cards():
            measured = update_measured(name, NewMeasurements(**new)) if card else load_measured(name)
            write_text(Path(scratch, f"{name}.json"), json.dumps(measured, indent=1) + "\n")
            write_text(Path(scratch, f"{name}.md"), build_card(name, measured))
        replace_changed_files(Path(scratch), FOLDER, dry_run=dry_run)


if __name__ == "__main__":
    main()

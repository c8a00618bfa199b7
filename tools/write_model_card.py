"""Write the model cards of the learned systems: docs/models/NAME.md, from what was measured.

    python -m tools.write_model_card SYSTEM [--open-loop FILE] [--run CONDITION=RUN]... [--train COMMAND]
        [--note TEXT] [--dry-run]

FILE is what `mdrive-sumo learn evaluate --out` wrote; RUN is a folder of `mdrive-sumo eval --agent SYSTEM`, several
of one condition are its seeds. Each option replaces its part of docs/models/SYSTEM.json, from which, and from the
manifest of the packaged weights, the card is written. Without arguments all cards are written again; a test compares.
"""

import json
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest, read_manifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.statistics import bootstrap_nested
from mdrive_sumo.core.tables import TOO_FEW
from mdrive_sumo.scoring import Results, compute_overall, load_results
from tools.seed_runs import check_seed_runs
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "models"
FAILURES = 8
"""Kinds of infractions that a card lists, the most frequent first."""
PLAN_ROWS = (
    ("the network", "plan"),
    ("constant velocity", "constant_velocity"),
    ("the network, images black", "blackout"),
)


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


def format_card(system: str, measured: Mapping[str, Any], manifest: WeightsManifest) -> str:
    """Return the card as Markdown."""
    spec = SYSTEMS[system]
    sections = [
        f"# Model card: `{system}`\n\nCounterpart of {spec.counterpart_of}, trained on mdrive-sumo data: the same role,"
        " inputs, outputs and controller, a network of our own. It is not the published model, and its scores are not"
        " those of the published model. Written by `python -m tools.write_model_card`.",
        "## Weights\n\n"
        + _format_table(
            ("", ""),
            (
                ("file", f"`{system}.onnx`, {manifest.bytes / 1e6:.2f} MB, half precision"),
                ("SHA-256", f"`{manifest.sha256}`"),
                ("parameters", f"{manifest.parameters:,}"),
                ("cameras", ", ".join(camera for image in spec.images for camera in image.cameras)),
                ("controller", f"`{spec.controller}`"),
            ),
        ),
        "## Training\n\n" + _format_training(manifest.training, measured),
    ]
    if "open_loop" in measured:
        sections.append("## Open loop\n\n" + _format_open_loop(measured["open_loop"]))
    if "closed_loop" in measured:
        sections.append("## Closed loop\n\n" + _format_closed_loop(measured["closed_loop"]))
    if "notes" in measured:
        sections.append("## Notes\n\n" + "\n".join(f"- {note}" for note in measured["notes"]))
    return "\n\n".join(sections) + "\n"


def _format_training(training: Mapping[str, Any], measured: Mapping[str, Any]) -> str:
    options: Mapping[str, Any] = training.get("options", {})
    rows = [
        ("data", f"{training.get('samples', '?')} samples: {', '.join(training.get('sources', ()))}"),
        ("kinds", ", ".join(f"{kind} {count}" for kind, count in training.get("kinds", {}).items()) or "?"),
        (
            "steps",
            f"{training.get('steps', '?')} of {options.get('batch', '?')} samples, seed {options.get('seed', '?')}",
        ),
        ("device", f"{training.get('device', '?')}, PyTorch {training.get('torch', '?')}"),
        ("time", f"{training['minutes']:.1f} minutes" if "minutes" in training else "?"),
    ]
    if begun := training.get("begun_with"):
        sources = ", ".join(begun["sources"])
        said = f"{begun['steps']} steps on {begun['samples']} samples ({sources}), {begun['minutes']:.1f} minutes"
        rows.append(("weights it began with", said))
    text = _format_table(("", ""), rows)
    if commands := measured.get("commands"):
        text += "\n\nTo train it again:\n\n```sh\n" + "\n".join(commands) + "\n```"
    return text


def _format_open_loop(found: Mapping[str, Any]) -> str:
    names = list(found["plan"])
    rows = [(label, *(f"{found[key][name]:.2f}" for name in names)) for label, key in PLAN_ROWS]
    header = ("plans of", *(f"{name.split('_')[0].upper()} {name.split('_')[1]} [m]" for name in names))
    kinds = ", ".join(
        f"{kind} {one['ade_3s_m']:.2f} m ({one['samples']})" for kind, one in sorted(found["by_kind"].items())
    )
    text = f"{found['samples']} samples of held-out drives ({', '.join(found.get('data', ()))}).\n\n"
    text += _format_table(header, rows) + f"\n\nADE over 3 s by what the expert does (samples): {kinds}."
    text += f" A decision takes {found['decision_ms']['median']:.1f} ms on one core (median)."
    if "control_l1" in found:
        text += " Mean distance of controls: " + ", ".join(f"{k} {v:.3f}" for k, v in found["control_l1"].items()) + "."
    return text


def _format_closed_loop(found: Mapping[str, Any]) -> str:
    rows = [
        (
            condition, one["suite"], ", ".join(map(str, one["seeds"])), f"{one['ds']:.2f}",
            " to ".join(f"{end:.2f}" for end in one["ds_interval"]) or TOO_FEW, f"{one['rc']:.2f}", f"{one['sr']:.2f}",
        )
        for condition, one in found.items()
    ]  # fmt: skip
    text = _format_table(("condition", "suite", "seeds", "DS", "95 %", "RC", "SR"), rows)
    for condition, one in found.items():
        kinds = ", ".join(f"{kind} {count}" for kind, count in one["infractions"].items()) or "none"
        text += (
            f"\n\nFailures, {condition}: {kinds} in {one['episodes']} episodes; lowest DS: {', '.join(one['worst'])}."
        )
    return text


def _format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(header)} |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


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


def update_measured(system: str, new: NewMeasurements) -> dict[str, Any]:
    """Return what is stored of a system with the new measurements. Raises InputError."""
    path = FOLDER / f"{system}.json"
    measured: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    if new.open_loop is not None:
        measured["open_loop"] = json.loads(new.open_loop.read_text("utf-8"))
        if (found := measured["open_loop"]["system"]) != system:
            raise InputError(f"{new.open_loop}: expected a measurement of {system}, found one of {found}")
    runs: dict[str, list[Results]] = defaultdict(list)
    for text in new.runs:
        condition, equals, folder = text.partition("=")
        if not equals:
            raise InputError(f"--run: expected CONDITION=RUN, found {text!r}")
        runs[condition].append(results := load_results(Path(folder) / "results.json"))
        if results.run.agent != system:
            raise InputError(f"{folder}: expected a run of {system}, found one of {results.run.agent}")
    for condition, found in runs.items():
        measured.setdefault("closed_loop", {})[condition] = summarise_runs(found)
    if new.commands:
        measured["commands"] = list(new.commands)
    if new.notes:
        measured["notes"] = list(new.notes)
    return measured


def list_cards() -> list[str]:
    """Return the systems that have a file of measurements."""
    return [system for system in SYSTEMS if (FOLDER / f"{system}.json").is_file()]


def load_measured(system: str) -> dict[str, Any]:
    """Return what is stored of a system."""
    return json.loads((FOLDER / f"{system}.json").read_text("utf-8"))


def build_card(system: str, measured: Mapping[str, Any]) -> str:
    """Return the card of a system. Raises InputError for measurements of other weights than the packaged ones."""
    manifest = read_manifest(WEIGHTS_FOLDER / f"{system}.json")
    if (found := measured["open_loop"]["sha256"]) != manifest.sha256:
        raise InputError(
            f"{system}: expected measurements of the packaged weights {manifest.sha256:.16}..., found those of"
            f" {found:.16}...; measure them anew"
        )
    return format_card(system, measured, manifest)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("system", required=False, type=click.Choice(tuple(SYSTEMS)))
@click.option("--open-loop", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="A new measurement.")
@click.option("--run", "runs", multiple=True, metavar="CONDITION=RUN", help="A run folder; may be repeated.")
@click.option(
    "--train", "commands", multiple=True, metavar="COMMAND", help="One of the commands of training, in order."
)
@click.option("--note", "notes", multiple=True, metavar="TEXT", help="A line of the card; may be repeated.")
@dry_run_option
def main(system: str | None, *, dry_run: bool, **new: Any) -> None:
    """Write the card of SYSTEM with new measurements, or all cards from what is stored."""
    if system is None and any(new.values()):
        raise InputError("expected a SYSTEM with these options, found none")
    with tempfile.TemporaryDirectory() as scratch:
        for name in [system] if system else list_cards():
            measured = update_measured(name, NewMeasurements(**new)) if system else load_measured(name)
            write_text(Path(scratch, f"{name}.json"), json.dumps(measured, indent=1) + "\n")
            write_text(Path(scratch, f"{name}.md"), build_card(name, measured))
        replace_changed_files(Path(scratch), FOLDER, dry_run=dry_run)


if __name__ == "__main__":
    main()

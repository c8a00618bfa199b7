"""The text of model cards, from what was measured and from the manifests of weights."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.tables import TOO_FEW
from mdrive_sumo.learning.fusion.detector_figures import FigureKey
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary

DETECTORS = "detectors"
"""The card of all weights that share features but those of `codriving`."""
INTRODUCTIONS: Mapping[str, str] = {
    DETECTORS: "Networks of our own with the ideas of the published fusions of these names, trained on mdrive-sumo data"
    " ([what they are](../fusion-frames.md)). They are not the published models, and their figures are not those of the"
    " published models.",
    CODRIVING: "Counterpart of CoDriving, trained on mdrive-sumo data ([what it is, and is not](../codriving.md)): a"
    " network of our own. It is not the published model, and its scores are not those of the published model.",
}
TEST_SETS: Mapping[str, str] = {"detectors": "test", "detectors-crowds": "test, crowds"}
"""Files of values with precisions, which are also names of pages, and the set that each was measured on."""
SHOWN_PRECISIONS = (
    FigureKey("clean", 0.5, "all"),
    FigureKey("clean", 0.7, "all"),
    FigureKey("0.2 m, 100 ms", 0.5, "all"),
    FigureKey("0.6 m", 0.5, "all"),
    FigureKey("300 ms", 0.5, "all"),
    FigureKey("clean", 0.5, "50-100 m"),
    FigureKey("clean", 0.5, "0 points"),
)
"""What a card says of precision; the last ones are where detectors fail."""
PLAN_ROWS = (
    ("the network", "plan"),
    ("constant velocity", "constant_velocity"),
    ("the network, images black", "blackout"),
)


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
                ("plan head", f"`{manifest.plan_head}`"),
            ),
        ),
        "## Training\n\n" + _format_training(manifest.training, measured),
    ]
    if "open_loop" in measured:
        sections.append("## Open loop\n\n" + _format_open_loop(measured["open_loop"]))
    return _join_sections(sections, measured)


def format_detector_card(
    card: str,
    measured: Mapping[str, Any],
    manifests: Mapping[str, tuple[WeightsManifest, WeightsManifest]],
    precisions: Mapping[str, DetectorSummary],
) -> str:
    """Return a card of detectors as Markdown.

    manifests: of encoder and fusion of each detector. precisions: by file in `TEST_SETS`; none of `codriving`.
    """
    weights = [
        (
            f"`{name}`",
            f"{sum(one.bytes for one in pair) / 1e6:.2f}",
            f"{sum(one.parameters for one in pair):,}",
            *(f"`{one.sha256[:16]}`" for one in pair),
        )
        for name, pair in manifests.items()
    ]
    names = ", ".join(f"`{name}`" for name in manifests)
    header = ("detector", "both files [MB]", "parameters", "SHA-256 of the encoder", "of fusion and head")
    sections = [
        f"# Model card: {names}\n\n{INTRODUCTIONS[card]} Written by `python -m tools.write_model_card`.",
        "## Weights\n\nTwo files for each, `NAME-encoder.onnx` and `NAME.onnx`, half precision.\n\n"
        + _format_table(header, weights),
        "## Training\n\n" + _format_detector_training({name: pair[1].training for name, pair in manifests.items()})
        + _format_commands(measured),
    ]  # fmt: skip
    sections += [
        f"## Precision, {TEST_SETS[file]}\n\n{_format_precisions(summary, file)}"
        for file, summary in precisions.items()
    ]
    return _join_sections(sections, measured)


def _format_detector_training(trainings: Mapping[str, Mapping[str, Any]]) -> str:
    header = (
        "detector", "frames", "steps", "learning rate", "seed", "gate", "began with", "validation", "device", "minutes",
    )  # fmt: skip
    rows: list[Sequence[str]] = []
    for name, training in trainings.items():
        options: Mapping[str, Any] = training.get("options", {})
        best: Mapping[str, Any] = training.get("best", {})
        rows.append(
            (
                f"`{name}`",
                f"{training.get('frames', '?')}: {_name_sources(training)}",
                f"{training.get('steps', '?')} of {options.get('batch', '?')} frames",
                f"{options.get('learning_rate', '?')}",
                f"{options.get('seed', '?')}",
                "yes" if training.get("is_gated") else "no",
                f"`{training['begun_with']['detector']}`" if "begun_with" in training else "random weights",
                f"{best['precision']:.3f}" if "precision" in best else "?",
                f"{training.get('device', '?')}, PyTorch {training.get('torch', '?')}",
                f"{training['minutes']:.1f}" if "minutes" in training else "?",
            )
        )
    return _format_table(header, rows) + (
        "\n\nSteps and minutes are those up to the best weights, which are the packaged ones; validation is the mean of"
        " the average precisions by which they were chosen, clean and with V2XSet's noise (`codriving`: and of the"
        " overlap of its forecast)."
    )


def _format_precisions(summary: DetectorSummary, page: str) -> str:
    def format_cell(name: str, key: FigureKey) -> str:
        interval = summary.precisions[name].get(key)
        if interval is None:
            return ""
        ends = "" if interval.ends is None else " [{:.1f}, {:.1f}]".format(*(100 * end for end in interval.ends))
        return f"{100 * interval.mean:.1f}{ends}"

    header = [f"AP@{key.min_iou} {key.condition if key.group == 'all' else key.group}" for key in SHOWN_PRECISIONS]
    rows = [(f"`{name}`", *(format_cell(name, key) for key in SHOWN_PRECISIONS)) for name in summary.precisions]
    data = next(iter(summary.about.values()))["data"]
    return (
        f"Average precision of vehicles in percent, on {data['frames']} frames at {len(data['places'])} places that no"
        f" training has seen; all of it is in [the results](../results/{page}.md).\n\n"
        + _format_table(("detector", *header), rows)
    )


def _join_sections(sections: Sequence[str], measured: Mapping[str, Any]) -> str:
    """Return the card: the sections, and what all cards end with."""
    parts = list(sections)
    if "closed_loop" in measured:
        parts.append("## Closed loop\n\n" + _format_closed_loop(measured["closed_loop"]))
    if "notes" in measured:
        parts.append("## Notes\n\n" + "\n".join(f"- {note}" for note in measured["notes"]))
    return "\n\n".join(parts) + "\n"


def _format_training(training: Mapping[str, Any], measured: Mapping[str, Any]) -> str:
    options: Mapping[str, Any] = training.get("options", {})
    rows = [
        ("data", _describe_data(training)),
        ("kinds", ", ".join(f"{kind} {count}" for kind, count in training.get("kinds", {}).items()) or "?"),
        (
            "steps",
            f"{training.get('steps', '?')} of {options.get('batch', '?')} samples, seed {options.get('seed', '?')}",
        ),
        ("device", f"{training.get('device', '?')}, PyTorch {training.get('torch', '?')}"),
        ("time", f"{training['minutes']:.1f} minutes" if "minutes" in training else "?"),
    ]
    if "best" in training:
        best: Mapping[str, Any] = training["best"]
        error = best["validation/ade_3s_m"]
        rows.append(("weights of", f"step {best['step']}, with the least ADE over 3 s on validation: {error:.3f} m"))
    rows += [
        (f"weights it began with, {back} before" if back else "weights it began with", said)
        for back, said in enumerate(_list_earlier(training))
    ]
    return _format_table(("", ""), rows) + _format_commands(measured)


def _describe_data(training: Mapping[str, Any]) -> str:
    """Return samples and data sets of a training."""
    return f"{training.get('samples', '?')} samples: {_name_sources(training)}"


def _name_sources(training: Mapping[str, Any]) -> str:
    """Return the data sets of a training by folder and name: where they lay on a host says nothing."""
    paths = [Path(source) for source in training.get("sources", ())]
    return ", ".join(str(Path(path.parent.name, path.name)) for path in paths)


def _list_earlier(training: Mapping[str, Any]) -> Iterable[str]:
    """Yield what the trainings were whose weights it began with, the last one first: rounds of DAgger."""
    while begun := training.get("begun_with"):
        yield f"{begun['steps']} steps on {_describe_data(begun)}; {begun['minutes']:.1f} minutes"
        training = begun


def _format_commands(measured: Mapping[str, Any]) -> str:
    commands = measured.get("commands")
    return "\n\nTo train it again:\n\n```sh\n" + "\n".join(commands) + "\n```" if commands else ""


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

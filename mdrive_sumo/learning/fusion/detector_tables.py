"""Tables of detectors that share: average precision by condition, distance, occlusion, channel and budget."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict

from mdrive_sumo.agents.learned.fusion_spec import BOUNDS, FUSIONS
from mdrive_sumo.core.statistics import (
    METHOD_NOTE,
    TOO_FEW_NOTE,
    ConfidenceInterval,
    ResampledMean,
    Verdict,
    describe_comparisons,
    judge_intervals,
)
from mdrive_sumo.core.tables import (
    Cell,
    Column,
    IntervalStyle,
    Row,
    Table,
    format_markdown,
    join_paragraphs,
    make_row,
)
from mdrive_sumo.learning.fusion.average_precision import GROUPS
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.detector_figures import CLEAN, MIN_IOUS, DetectorFigures, FigureKey
from mdrive_sumo.learning.fusion.sharing_channels import BUDGETS, CHANNELS

FORMAT = "mdrive-sumo/detectors/1"
ORDER = (*BOUNDS, *FUSIONS)
BASE = "none"
Figures = Mapping[str, DetectorFigures]
HOW_TO_READ = f"""\
Average precision (percent) of vehicles, at all points of the curve, sorted over the whole set, over the boxes on which
any car of a frame has a point. {METHOD_NOTE} Here drives take the place of scenarios. {TOO_FEW_NOTE}"""
CHANNEL_NOTE = """\
Maps are encoded by the codec of messages; bytes are payloads of one map. A surrogate of drives: a map every 200 ms,
fused 100 ms after the own scan; the radio models of `its-g5` and `lte-v2x` between the cars of a frame, which stand
still, in line of sight or behind the frame's vehicles, without buildings and other stations. `early` shares its cells
without loss (zlib) and fits into no radio's budget; `late` shares boxes in one CPM. Poses are true."""
OPV2V_NOTE = """\
Published figures of CARLA, for comparison only (OPV2V, default towns, AP at 0.7): late 78.1, early 80.0, AttFuse 81.5,
F-Cooper 79.0, CoBEVT 86.1. V2XSet, AP at 0.7 from perfect to noisy (0.2 m, 0.2 degrees, 100 ms): late 62.0 to 30.7,
AttFuse 66.4 to 48.7, CoBEVT 66.0 to 54.3, no fusion 40.2."""


def write_detectors_page(figures: Figures) -> str:
    """Return all tables as a page of Markdown."""
    data = next(iter(figures.values())).about["data"]
    names = [condition.name for condition in CONDITIONS]
    channels, budgets = ([each.name for each in kind] for kind in (CHANNELS, BUDGETS))
    differences = list_differences(figures, names)
    return join_paragraphs(
        (
            "# Detectors that share features: average precision",
            f"Measured on {data['frames']} frames of {data['drives']} drives at {len(data['places'])} places with"
            f" {data['vehicles']} true boxes of vehicles.",
            HOW_TO_READ,
            "## By condition, intersection over union 0.5",
            format_markdown(_build_table(figures, names, MIN_IOUS[0])),
            "## By condition, intersection over union 0.7",
            format_markdown(_build_table(figures, names, MIN_IOUS[1])),
            "## Differences from no fusion, intersection over union 0.5",
            format_markdown(_build_difference_table(figures, names)),
            describe_comparisons([one for _, _, one in differences]),
            *_describe_losses(differences),
            "## By distance and by points of the own scan, clean",
            *(format_markdown(_build_group_table(figures, min_iou)) for min_iou in MIN_IOUS),
            "## Channels",
            CHANNEL_NOTE,
            format_markdown(_build_table(figures, channels, MIN_IOUS[0])),
            format_markdown(_build_use_table(figures, channels)),
            "## Bytes",
            format_markdown(_build_table(figures, [*budgets, CHANNELS[0].name], MIN_IOUS[0], FUSIONS)),
            format_markdown(_build_use_table(figures, [*budgets, CHANNELS[0].name], FUSIONS)),
            OPV2V_NOTE,
        )
    )


def write_detectors_json(figures: Figures) -> str:
    """Return all numbers as JSON, without resamples."""
    rows = [
        {"detector": name, "condition": key.condition, "iou": key.min_iou, "group": key.group}
        | asdict(value.make_interval())
        for name, each in _sort(figures)
        for key, value in each.precisions.items()
    ]
    names = [each.name for each in (*CONDITIONS, *CHANNELS, *BUDGETS)]
    page = {
        "format": FORMAT,
        "about": {name: each.about for name, each in _sort(figures)},
        "precisions": rows,
        "differences": [
            {"detector": name, "condition": condition, "iou": MIN_IOUS[0], "from": BASE} | asdict(value)
            for name, condition, value in list_differences(figures, names)
        ],
        "use": {name: each.use for name, each in _sort(figures)},
    }
    return json.dumps(page, indent=1) + "\n"


def list_differences(figures: Figures, conditions: Sequence[str]) -> list[tuple[str, str, ConfidenceInterval]]:
    """Return detector, condition and difference from `none` at an intersection over union of 0.5, drive by drive."""
    if BASE not in figures:
        return []
    found: list[tuple[str, str, ConfidenceInterval]] = []
    for name, each in _sort(figures):
        for condition in conditions:
            key = FigureKey(condition, MIN_IOUS[0], "all")
            base = figures[BASE].precisions.get(key)
            if name != BASE and base is not None and key in each.precisions:
                found.append((name, condition, each.precisions[key].subtract(base)))
    return found


def _describe_losses(differences: Sequence[tuple[str, str, ConfidenceInterval]]) -> Iterable[str]:
    """Yield where fusions are better and where they are worse than no fusion."""
    fusions = [each for each in differences if each[0] in FUSIONS]
    if not fusions:
        return
    verdicts = judge_intervals([value for _, _, value in fusions])
    shown = sum(verdict is Verdict.GAIN for verdict in verdicts)
    below = [f"{name} ({condition}, {100 * value.mean:+.1f})" for name, condition, value in fusions if value.mean < 0]
    yield (
        f"Of {len(fusions)} pairs of a fusion and a condition {shown} are above no fusion after correction. Below it"
        f" are {', '.join(below) or 'none'}."
    )


def _sort(figures: Figures, names: Iterable[str] = ORDER) -> list[tuple[str, DetectorFigures]]:
    return [(name, figures[name]) for name in names if name in figures]


def _make_columns(labels: Iterable[str], *, has_sign: bool = False) -> tuple[Column, ...]:
    return (
        Column("detector", "detector"),
        *(
            Column(label, label, decimals=1, has_sign=has_sign, intervals=IntervalStyle.ENDS, undefined="")
            for label in labels
        ),
    )


def _make_cell(interval: ConfidenceInterval | None) -> Cell:
    """Return a cell in percent."""
    if interval is None:
        return Cell(None)
    low, high = (None if end is None else 100 * end for end in (interval.low, interval.high))
    return Cell(100 * interval.mean, ConfidenceInterval(100 * interval.mean, low, high, interval.units))


def _find_interval(figures: DetectorFigures, key: FigureKey) -> ConfidenceInterval | None:
    value: ResampledMean | None = figures.precisions.get(key)
    return None if value is None else value.make_interval()


def _build_table(figures: Figures, conditions: Sequence[str], min_iou: float, names: Iterable[str] = ORDER) -> Table:
    rows = [
        make_row((name, *(_make_cell(_find_interval(each, FigureKey(one, min_iou, "all"))) for one in conditions)))
        for name, each in _sort(figures, names)
    ]
    return Table("detectors", "", _make_columns(conditions), tuple(rows), left=1)


def _build_difference_table(figures: Figures, conditions: Sequence[str]) -> Table:
    by_detector: dict[str, dict[str, ConfidenceInterval]] = {}
    for name, condition, value in list_differences(figures, conditions):
        by_detector.setdefault(name, {})[condition] = value
    rows = [
        make_row((name, *(_make_cell(values.get(condition)) for condition in conditions)))
        for name, values in by_detector.items()
    ]
    return Table("detector_differences", "", _make_columns(conditions, has_sign=True), tuple(rows), left=1)


def _build_group_table(figures: Figures, min_iou: float) -> Table:
    groups = [name for name in GROUPS if name != "all"]
    rows = [
        make_row((name, *(_make_cell(_find_interval(each, FigureKey(CLEAN, min_iou, group))) for group in groups)))
        for name, each in _sort(figures)
    ]
    columns = _make_columns([f"{group}, IoU {min_iou}" for group in groups])
    return Table("detector_groups", "", columns, tuple(rows), left=1)


def _build_use_table(figures: Figures, names: Sequence[str], detectors: Iterable[str] = ORDER) -> Table:
    columns = (
        Column("detector", "detector"),
        Column("channel", "channel"),
        Column("map_bytes", "bytes of a map", decimals=0),
        Column("heard", "senders heard [%]", decimals=1),
        Column("age_ms", "mean age [ms]", decimals=0),
        Column("packets_arrived", "packets used [%]", decimals=1),
    )
    rows: list[Row] = []
    for detector, each in _sort(figures, detectors):
        for name in names:
            if (use := each.use.get(name)) is not None:
                shares = {key: 100 * use[key] for key in ("heard", "packets_arrived") if key in use}
                values = {**use, **shares}
                rows.append(make_row((detector, name, *(values.get(column.key) for column in columns[2:]))))
    return Table("detector_channels", "", columns, tuple(rows), left=2)

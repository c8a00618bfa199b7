"""Tables of detectors that share: average precision by condition, distance, occlusion, channel and budget."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from mdrive_sumo.agents.learned.fusion_spec import BOUNDS, FUSIONS
from mdrive_sumo.core.statistics import (
    METHOD_NOTE,
    TOO_FEW_NOTE,
    ConfidenceInterval,
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
PUBLISHED: Mapping[str, tuple[float | None, float | None, float | None]] = {
    "none": (None, 40.2, 40.2),
    "late": (78.1, 62.0, 30.7),
    "early": (80.0, None, None),
    "attfuse": (81.5, 66.4, 48.7),
    "fcooper": (79.0, None, None),
    "cobevt": (86.1, 66.0, 54.3),
}
"""AP at 0.7 on CARLA's images: of OPV2V (default towns), of V2XSet with perfect poses and with its noise."""
PUBLISHED_NOTE = """\
Columns named CARLA are figures that others published, of the original detectors on data of CARLA: OPV2V (default towns)
and V2XSet, perfect and noisy (0.2 m, 0.2 degrees, 100 ms). They show orders and losses there; data, networks and ranges
differ, so no number of a row can be expected to be the same."""


@dataclass(frozen=True, slots=True)
class DetectorSummary:
    """What tables show of some detectors on one data set: figures without resamples, as `detectors.json` keeps them."""

    about: Mapping[str, Mapping[str, Any]]
    """By detector, in the order of `ORDER`, as all mappings: data, checkpoint and training, JSON."""
    precisions: Mapping[str, Mapping[FigureKey, ConfidenceInterval]]
    """Average precisions of vehicles in [0, 1]."""
    differences: Mapping[str, Mapping[str, ConfidenceInterval]]
    """From `none` at an intersection over union of 0.5, drive by drive, by detector and condition."""
    use: Mapping[str, Mapping[str, Mapping[str, float]]]
    """By detector and channel or budget: bytes of a map, and what arrived."""


def summarise_detectors(figures: Figures) -> DetectorSummary:
    """Return what tables show of figures that were measured on the same frames."""
    members = {name: figures[name] for name in ORDER if name in figures}
    base = members.get(BASE)
    conditions = [each.name for each in (*CONDITIONS, *CHANNELS, *BUDGETS)]
    differences: dict[str, dict[str, ConfidenceInterval]] = {}
    for name, each in members.items():
        for condition in conditions if base is not None and each is not base else ():
            key = FigureKey(condition, MIN_IOUS[0], "all")
            if (value := each.precisions.get(key)) and (reference := base and base.precisions.get(key)):
                differences.setdefault(name, {})[condition] = value.subtract(reference)
    return DetectorSummary(
        {name: each.about for name, each in members.items()},
        {
            name: {key: value.make_interval() for key, value in each.precisions.items()}
            for name, each in members.items()
        },
        differences,
        {name: each.use for name, each in members.items()},
    )


def write_detectors_page(summary: DetectorSummary) -> str:
    """Return all tables as a page of Markdown."""
    return join_paragraphs(
        (
            "# Detectors that share features: average precision",
            HOW_TO_READ,
            *(part for title, name in SECTIONS for part in (f"## {title}", *TABLES[name](summary))),
        )
    )


def write_detectors_json(summary: DetectorSummary) -> str:
    """Return all numbers as JSON, without resamples."""
    page = {
        "format": FORMAT,
        "about": summary.about,
        "precisions": [
            {"detector": name, "condition": key.condition, "iou": key.min_iou, "group": key.group} | asdict(interval)
            for name, intervals in summary.precisions.items()
            for key, interval in intervals.items()
        ],
        "differences": [
            {"detector": name, "condition": condition, "iou": MIN_IOUS[0], "from": BASE} | asdict(interval)
            for name, intervals in summary.differences.items()
            for condition, interval in intervals.items()
        ],
        "use": summary.use,
    }
    return json.dumps(page, indent=1) + "\n"


def _describe_data(summary: DetectorSummary) -> str:
    data = next(iter(summary.about.values()))["data"]
    return (
        f"Measured on {data['frames']} frames of {data['drives']} drives at {len(data['places'])} places with"
        f" {data['vehicles']} true boxes of vehicles."
    )


def _list_conditions(summary: DetectorSummary) -> Sequence[str]:
    names = [condition.name for condition in CONDITIONS]
    tables = (
        part
        for min_iou in MIN_IOUS
        for part in (
            f"At an intersection over union of {min_iou}:",
            format_markdown(_build_table(summary, names, min_iou)),
        )
    )
    return _describe_data(summary), *tables


def _list_differences(summary: DetectorSummary) -> Sequence[str]:
    names = [condition.name for condition in CONDITIONS]
    found = [
        (name, condition, intervals[condition])
        for name, intervals in summary.differences.items()
        for condition in names
        if condition in intervals
    ]
    return (
        format_markdown(_build_difference_table(summary, names)),
        describe_comparisons([interval for _, _, interval in found]),
        *_describe_losses(found),
    )


def _list_groups(summary: DetectorSummary) -> Sequence[str]:
    return [format_markdown(_build_group_table(summary, min_iou)) for min_iou in MIN_IOUS]


def _list_channels(summary: DetectorSummary) -> Sequence[str]:
    names = [channel.name for channel in CHANNELS]
    return (
        CHANNEL_NOTE,
        format_markdown(_build_table(summary, names, MIN_IOUS[0])),
        format_markdown(_build_use_table(summary, names)),
    )


def _list_bytes(summary: DetectorSummary) -> Sequence[str]:
    names = [*(budget.name for budget in BUDGETS), CHANNELS[0].name]
    return (
        format_markdown(_build_table(summary, names, MIN_IOUS[0], FUSIONS)),
        format_markdown(_build_use_table(summary, names, FUSIONS)),
    )


def _list_published(summary: DetectorSummary) -> Sequence[str]:
    keys = [FigureKey(condition, MIN_IOUS[1], "all") for condition in (CLEAN, "0.2 m, 100 ms")]
    here = _make_columns([f"here, {key.condition}" for key in keys])
    carla = [f"CARLA, {name}" for name in ("OPV2V", "V2XSet perfect", "V2XSet noisy")]
    columns = (*here, *(Column(label, label, decimals=1, undefined="") for label in carla))
    rows = [
        make_row(
            (
                name,
                *(_make_cell(summary.precisions[name].get(key)) for key in keys),
                *PUBLISHED.get(name, (None,) * len(carla)),
            )
        )
        for name in summary.precisions
    ]
    return PUBLISHED_NOTE, format_markdown(Table("published", "", columns, tuple(rows), left=1))


TABLES: Mapping[str, Callable[[DetectorSummary], Sequence[str]]] = {
    "conditions": _list_conditions,
    "differences": _list_differences,
    "groups": _list_groups,
    "channels": _list_channels,
    "bytes": _list_bytes,
    "published": _list_published,
}
"""Paragraphs of each table, as pages show them."""
SECTIONS = (
    ("By condition", "conditions"),
    (f"Differences from no fusion, intersection over union {MIN_IOUS[0]}", "differences"),
    ("By distance and by points of the own scan, clean", "groups"),
    ("Channels", "channels"),
    ("Bytes", "bytes"),
    (f"Beside published figures, intersection over union {MIN_IOUS[1]}", "published"),
)


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


def _build_table(
    summary: DetectorSummary, conditions: Sequence[str], min_iou: float, names: Iterable[str] = ORDER
) -> Table:
    rows = [
        make_row((name, *(_make_cell(intervals.get(FigureKey(one, min_iou, "all"))) for one in conditions)))
        for name, intervals in summary.precisions.items()
        if name in names
    ]
    return Table("detectors", "", _make_columns(conditions), tuple(rows), left=1)


def _build_difference_table(summary: DetectorSummary, conditions: Sequence[str]) -> Table:
    rows = [
        make_row((name, *(_make_cell(intervals.get(condition)) for condition in conditions)))
        for name, intervals in summary.differences.items()
    ]
    return Table("detector_differences", "", _make_columns(conditions, has_sign=True), tuple(rows), left=1)


def _build_group_table(summary: DetectorSummary, min_iou: float) -> Table:
    groups = [name for name in GROUPS if name != "all"]
    rows = [
        make_row((name, *(_make_cell(intervals.get(FigureKey(CLEAN, min_iou, group))) for group in groups)))
        for name, intervals in summary.precisions.items()
    ]
    columns = _make_columns([f"{group}, IoU {min_iou}" for group in groups])
    return Table("detector_groups", "", columns, tuple(rows), left=1)


def _build_use_table(summary: DetectorSummary, names: Sequence[str], detectors: Iterable[str] = ORDER) -> Table:
    columns = (
        Column("detector", "detector"),
        Column("channel", "channel"),
        Column("map_bytes", "bytes of a map", decimals=0),
        Column("heard", "senders heard [%]", decimals=1),
        Column("age_ms", "mean age [ms]", decimals=0),
        Column("packets_arrived", "packets used [%]", decimals=1),
    )
    rows: list[Row] = []
    for detector in (one for one in summary.use if one in detectors):
        for name in names:
            if (use := summary.use[detector].get(name)) is not None:
                shares = {key: 100 * use[key] for key in ("heard", "packets_arrived") if key in use}
                values = {**use, **shares}
                rows.append(make_row((detector, name, *(values.get(column.key) for column in columns[2:]))))
    return Table("detector_channels", "", columns, tuple(rows), left=2)

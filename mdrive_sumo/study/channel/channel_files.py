"""The study of channels as files: a CSV for each measure, `channel.json` and `channel.md`."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mdrive_sumo.core.state import DT
from mdrive_sumo.core.tables import (
    CellValue,
    Column,
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
)
from mdrive_sumo.report.result_tables import list_percent
from mdrive_sumo.study.channel.channel_load import LoadOfSecond
from mdrive_sumo.study.channel.channel_study import RunMeasures
from mdrive_sumo.study.channel.link_measures import (
    NOTHING,
    RING_M,
    Counts,
    LinkCounts,
    LinkGroup,
    add_counts,
    list_link_classes,
)
from mdrive_sumo.study.study_files import dump_page, format_facts

FORMAT = "mdrive-sumo/channel-study/1"
LATE_SHARE = 0.95
"""Of gaps and ages the mean says little: the value that 95 % do not exceed says how bad it gets."""
HOW_TO_READ = """\
**Received** is the share of pairs of a transmitted message and a station in the world that could have received it
(3GPP TR 36.885): messages that the sender's radio never transmitted (muted, over the budget, malformed) are not in it.
A **gap** is the time between two receptions of a type from the same sender; the **age** of information is the time
since the newest received message was sent, over all ticks from the first reception until a station ends. **Known** is
the environmental awareness ratio: the share of vehicles, cyclists and pedestrians within 100 m of a CAV that it knows
by its own sensors (at least a tenth visible within 100 m), or by a CAM or an object of a CPM of the last second.
**Busy** is the mean channel busy ratio of all stations (ETSI TS 102 687), where the channel is a radio.
No intervals: messages of an episode depend on each other; counts stand in the CSV files."""


def channel_json(measured: Sequence[RunMeasures], command: Sequence[str]) -> str:
    """Return what was measured and how: runs, settings, counts by status, and the summary."""
    page = {
        "format": FORMAT,
        "command": list(command),
        "runs": [_describe_run(run) for run in measured],
        "summary": [dict(_list_summary_values(run, name)) for run in measured for name in _list_classes(run)],
    }
    return dump_page(page)


def _describe_run(run: RunMeasures) -> dict[str, Any]:
    info = run.stored.results.run
    statuses = [
        {"class": group.link_class, "type": group.message_type, "status": status, "deliveries": count}
        for (group, status), count in sorted(run.links.statuses.items())
    ]
    return {
        "name": run.name,
        "agent": info.agent,
        "suite": info.suite_label,
        "suite_checksum": info.suite_checksum,
        "seeds": list(info.all_seeds),
        "comm": info.comm,
        "versions": info.versions,
        "episodes": run.episodes,
        "statuses": statuses,
    }


def channel_markdown(measured: Sequence[RunMeasures], command: str, pictures: Sequence[str]) -> str:
    """Return the study as a page."""
    runs = {run.name: f"{run.episodes} episodes of {run.stored.results.run.suite_label}" for run in measured}
    parts = (
        "# What the channel did",
        format_facts(runs | {"command": f"`{command}`"}),
        HOW_TO_READ,
        format_markdown(build_summary_table(measured)),
        format_markdown(build_status_table(measured)),
        *(f"![{picture.partition('.')[0]}]({picture})" for picture in pictures),
    )
    return join_paragraphs(parts)


def build_summary_table(measured: Sequence[RunMeasures]) -> Table:
    """Return a row for each run and class of links."""
    columns = (
        *make_text_columns({"run": "run", "class": "links"}),
        Column("deliveries", "messages x receivers", decimals=0),
        Column("received", "received %", decimals=1),
        Column("gap", "gap s", decimals=2),
        Column("gap_95", "gap 95 % s", decimals=2),
        Column("age", "age s", decimals=2),
        Column("age_95", "age 95 % s", decimals=2),
        Column("busy", "busy %", decimals=1),
        Column("seen", "known by sensors %", decimals=1),
        Column("known", "and by messages %", decimals=1),
    )
    rows = [
        make_row([value for _, value in _list_summary_values(run, name)])
        for run in measured
        for name in _list_classes(run)
    ]
    return Table("channel", "What the channel did", columns, tuple(rows), left=2)


ALL_CLASSES = "all"


def _list_classes(run: RunMeasures) -> list[str]:
    """Return "all", and the classes of links if the recordings have several."""
    classes = list_link_classes(ring.group for ring in run.links.transmitted)
    return [ALL_CLASSES, *(classes if len(classes) > 1 else ())]


def _list_summary_values(run: RunMeasures, link_class: str) -> Iterator[tuple[str, CellValue]]:
    """Yield the values of a row by the keys of its columns; load and awareness are of stations, not of links."""
    is_all = link_class == ALL_CLASSES
    transmitted, received = (
        sum(count for ring, count in counts.items() if is_all or ring.group.link_class == link_class)
        for counts in (run.links.transmitted, run.links.received)
    )
    yield "run", run.name
    yield "class", link_class
    yield "deliveries", transmitted
    yield "received", 100 * received / transmitted if transmitted else None
    for name, by_group in (("gap", run.links.gaps), ("age", run.links.ages)):
        counts = sum_counts(by_group, "" if is_all else link_class)
        yield name, compute_mean_s(counts)
        yield f"{name}_95", find_late_s(counts)
    shares = (run.loads.compute_mean(), *(run.awareness.compute_ratio(counts) for counts in _list_known(run)))
    percents = list_percent([share if is_all else None for share in shares])
    yield from zip(("busy", "seen", "known"), percents, strict=True)


def _list_known(run: RunMeasures) -> tuple[Counter[int], Counter[int]]:
    return run.awareness.seen, run.awareness.known


def sum_counts(by_group: Mapping[LinkGroup, Counts], link_class: str = "", message_type: str = "") -> Counts:
    """Return the counts over all groups of a class and a type; "" stands for all."""
    total = NOTHING
    for group, counts in by_group.items():
        if link_class in ("", group.link_class) and message_type in ("", group.message_type):
            total = add_counts(total, counts)
    return total


def compute_mean_s(counts: Counts) -> float | None:
    """Return the mean [s] of counts by ticks; None without any."""
    total = int(counts.sum())
    return float((counts * np.arange(len(counts))).sum()) / total * DT if total else None


def find_late_s(counts: Counts) -> float | None:
    """Return the least time [s] that `LATE_SHARE` of the counts by ticks do not exceed; None without any."""
    total = int(counts.sum())
    if not total:
        return None
    return int(np.searchsorted(np.cumsum(counts), LATE_SHARE * total)) * DT


def build_status_table(measured: Sequence[RunMeasures]) -> Table:
    """Return a row for each run and status: what became of messages, by type."""
    types = sorted({group.message_type for run in measured for group, _ in run.links.statuses})
    rows = [
        make_row(
            [
                run.name,
                status,
                *(
                    sum(n for (group, s), n in run.links.statuses.items() if (group.message_type, s) == (name, status))
                    for name in types
                ),
            ]
        )
        for run in measured
        for status in sorted({status for _, status in run.links.statuses})
    ]
    columns = (
        *make_text_columns({"run": "run", "status": "delivery status"}),
        *(Column(name, name, decimals=0) for name in types),
    )
    return Table("statuses", "What became of messages", columns, tuple(rows), left=2)


def reception_csv(measured: Sequence[RunMeasures]) -> str:
    """Return one line for each run, class, type and ring of distances."""
    columns = (
        *make_text_columns({"run": "run", "class": "class", "type": "type"}),
        *(Column(name, name) for name in ("from_m", "to_m", "transmitted", "received", "ratio")),
    )
    rows = [
        make_row(
            (
                run.name,
                *ring.group,
                ring.number * RING_M,
                (ring.number + 1) * RING_M,
                count,
                run.links.received[ring],
                run.links.received[ring] / count,
            )
        )
        for run in measured
        for ring, count in sorted(run.links.transmitted.items())
    ]
    return format_csv(Table("reception", "", columns, tuple(rows)))


def times_csv(measured: Sequence[RunMeasures], measure: str) -> str:
    """Return one line for each run, class, type and time that was counted. measure: "gaps" or "ages"."""
    columns = (
        *make_text_columns({"run": "run", "class": "class", "type": "type"}),
        *(Column(name, name) for name in ("seconds", "count")),
    )
    rows = [
        make_row((run.name, *group, round(ticks * DT, 2), int(counts[ticks])))
        for run in measured
        for group, counts in sorted(_get_times(run.links, measure).items())
        for ticks in np.flatnonzero(counts).tolist()
    ]
    return format_csv(Table(measure, "", columns, tuple(rows)))


def _get_times(links: LinkCounts, measure: str) -> Mapping[LinkGroup, Counts]:
    return links.gaps if measure == "gaps" else links.ages


def busy_csv(measured: Sequence[RunMeasures]) -> str:
    """Return one line for each run and second: how many stations measured, and their busy ratios in [0, 1]."""
    columns = (*make_text_columns({"run": "run"}), *(Column(name, name) for name in LoadOfSecond._fields))
    rows = [make_row((run.name, *load)) for run in measured for load in run.loads.list_seconds()]
    return format_csv(Table("busy", "", columns, tuple(rows)))


def awareness_csv(measured: Sequence[RunMeasures]) -> str:
    """Return one line for each run and ring of distances: relevant road users, and how many of them were known."""
    names = ("from_m", "to_m", "relevant", "seen", "told", "known")
    columns = (*make_text_columns({"run": "run"}), *(Column(name, name) for name in names))
    rows = [
        make_row(
            (
                run.name,
                ring * RING_M,
                (ring + 1) * RING_M,
                *(counts[ring] for counts in (found.relevant, found.seen, found.told, found.known)),
            )
        )
        for run in measured
        for found in (run.awareness,)
        for ring in sorted(found.relevant)
    ]
    return format_csv(Table("awareness", "", columns, tuple(rows)))

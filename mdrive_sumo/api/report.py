"""A report over several runs: what `mdrive-sumo report` writes, as a value."""

import html
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.api.run import Run
from mdrive_sumo.core.data_frame import build_data_frame
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.core.tables import Table, format_text
from mdrive_sumo.report.comparison_report.compared_agent import make_compared_agents
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport, build_comparison_report
from mdrive_sumo.report.comparison_report.report_runs import load_report_runs
from mdrive_sumo.report.comparison_report.write_comparison_report import render_report_page, write_comparison_report
from mdrive_sumo.report.replay_page import FRAME_HEIGHT_PX

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RunsReport:
    """A report over several runs: a notebook shows it inline, `save` writes its files."""

    content: ComparisonReport

    @property
    def tables(self) -> Mapping[str, Table]:
        """The tables by name: main, buckets, levels, differences, ..."""
        return {table.name: table for table in self.content.tables}

    def to_frame(self, table: str = "main") -> "pd.DataFrame":
        """Return a table with one row per line and its columns by key. Needs pandas. Raises InputError."""
        if table not in self.tables:
            expected = ", ".join(self.tables)
            raise InputError(f"table: expected one of {expected}, found {table!r}{suggest_name(table, self.tables)}")
        shown = self.tables[table]
        keys = [column.key for column in shown.columns]
        return build_data_frame(dict(zip(keys, (cell.value for cell in row.cells), strict=True)) for row in shown.rows)

    def save(self, out: str | Path) -> Path:
        """Write the files of `mdrive-sumo report` into a new or empty folder and return it. Raises InputError."""
        write_comparison_report(self.content, Path(out))
        return Path(out)

    def __str__(self) -> str:
        return format_text(self.tables["main"])

    def __repr__(self) -> str:
        return f"RunsReport({self.content.title!r}, {len(self.tables)} tables; .save(folder) writes it)"

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, so that its style does not reach the notebook."""
        images = {figure.name: figure.render("svg")[0] for figure in self.content.figures}
        page = html.escape(render_report_page(self.content, images))
        return f'<iframe srcdoc="{page}" width="100%" height="{FRAME_HEIGHT_PX}" style="border: 0" sandbox></iframe>'


def build_report(
    runs: Iterable[Run | str | Path], *, baseline: str = "", with_published: bool = False, mix_seasons: bool = False
) -> RunsReport:
    """Return a report over runs, given as `Run` or by their folders.

    baseline: name of the agent with which all others are compared; by default each is with each. with_published:
    whether the main table has the paper's CARLA rows, set apart. mix_seasons: whether runs of an agent in several
    seasons are one line of a table; without it they are refused. Raises InputError for runs that cannot stand in one
    report.
    """
    folders = [folder for run in runs for folder in (run.folders if isinstance(run, Run) else (Path(run),))]
    agents = make_compared_agents(load_report_runs(folders, mix_seasons=mix_seasons))
    return RunsReport(build_comparison_report(agents, baseline=baseline, with_published=with_published))

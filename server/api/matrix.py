"""DS of every team in every scenario of a phase, for organisers: which scenarios are hard, and for whose agents."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import fmean

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.api import submission_views
from server.api.problems import HiddenScenariosError
from server.api.schemas.scenarios import MatrixCellOut, MatrixColumnOut, MatrixOut, MatrixRowOut
from server.api.submission_views import Caller
from server.enums import ChallengeTrack, JobKind, ScenarioVerdict
from server.store import Store, phases, queries
from server.store.tables import JobOverviewRow, JobRow

TEAMS_PER_PAGE = 20
"""Teams of one page: with 225 scenarios 4500 results, which are read one by one."""
_Cells = Mapping[str, Mapping[str, MatrixCellOut]]
"""Cells by scenario and submission."""


def read_matrix(store: Store, caller: Caller, phase_id: str, track: ChallengeTrack | None, page: int) -> MatrixOut:
    """Return the best shown submission of each team of a leaderboard, 20 teams per page.

    Raises NotFound for an unknown phase, HiddenScenariosError for those who may not see its scenarios.
    """
    with store.read() as session:
        if not submission_views.may_see_scenarios(caller, phases.get(session, phase_id)):
            raise HiddenScenariosError
        entries = queries.find_leaderboard(session, phase_id, track)
        pages = max(1, -(-len(entries) // TEAMS_PER_PAGE))
        page = min(page, pages)
        columns = [
            MatrixColumnOut(
                team=entry.team,
                submission=entry.submission or "",
                method=entry.method,
                track=ChallengeTrack(entry.track),
                rank=entry.rank,
                ds=entry.ds,
            )
            for entry in entries[(page - 1) * TEAMS_PER_PAGE : page * TEAMS_PER_PAGE]
        ]
        rows = _read_rows(session, [column.submission for column in columns])
    return MatrixOut(phase=phase_id, track=track, page=page, pages=pages, columns=columns, rows=rows)


def _read_rows(session: Session, submissions: Sequence[str]) -> list[MatrixRowOut]:
    data = JobOverviewRow.data
    wanted = (
        select(
            *(JobRow.submission, JobRow.scenario, JobRow.verdict, data["ds"].as_float()),
            *(data["bucket"].as_string(), data["category"].as_string()),
        )
        .join(JobOverviewRow, JobOverviewRow.job == JobRow.id)
        .where(JobRow.kind == JobKind.SUBMISSION, JobRow.submission.in_(submissions))
        .order_by(JobRow.scenario, JobRow.submission, JobRow.seed)
    )
    seeds: dict[str, dict[str, list[tuple[float, bool]]]] = defaultdict(lambda: defaultdict(list))
    labels: dict[str, tuple[str | None, str | None]] = {}
    for submission, scenario, verdict, ds, bucket, category in session.execute(wanted):
        if ds is not None:
            seeds[scenario][submission].append((ds, verdict == ScenarioVerdict.AGENT_FAILED))
            labels[scenario] = bucket, category
    cells = {
        scenario: {
            submission: MatrixCellOut(ds=fmean(ds for ds, _ in of_seeds), failed=sum(failed for _, failed in of_seeds))
            for submission, of_seeds in of_scenario.items()
        }
        for scenario, of_scenario in seeds.items()
    }
    return [_make_row(scenario, labels[scenario], cells, submissions) for scenario in cells]


def _make_row(
    scenario: str, labels: tuple[str | None, str | None], cells: _Cells, submissions: Sequence[str]
) -> MatrixRowOut:
    of_scenario = cells[scenario]
    return MatrixRowOut(
        scenario=scenario,
        bucket=labels[0],
        category=labels[1],
        ds=fmean(cell.ds for cell in of_scenario.values()),
        failed=sum(cell.failed > 0 for cell in of_scenario.values()),
        cells=[of_scenario.get(submission) for submission in submissions],
    )

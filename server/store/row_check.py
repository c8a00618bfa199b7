"""Compare rows with the audit log: a score changed in the database is found, because the hash chain holds the true one.

Compared are teams, tokens, phases, webhooks, submissions with their summaries, the results of their scenarios,
leaderboards, and the results of cross-play. docs/server-database.md lists every table and what is not compared.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.tree_difference import format_leaf
from server.enums import JobKind, JobState, SubmissionState
from server.store import audit, overviews, standings, webhooks
from server.store.audited_rows import Columns, load_audited_rows, name_pair
from server.store.quota import UNFINISHED
from server.store.tables import (
    JobOverviewRow,
    JobRow,
    PhaseRow,
    StandingRow,
    SubmissionRow,
    TeamRow,
    TokenRow,
    WebhookRow,
)


@dataclass(frozen=True, slots=True)
class RowDifference:
    """A row that is not as the audit log says."""

    table: str
    row: str
    text: str
    """Which column differs, what was expected and what was found."""

    def __str__(self) -> str:
        return f"{self.table} {self.row}: {self.text}"


def find_row_differences(session: Session, with_results: bool = True) -> Iterator[RowDifference]:
    """Yield every difference between the rows and the audit log, whose hashes `audit.verify_chain` verifies.

    with_results: also read the results of all scenarios, which can be gigabytes.
    """
    audited = load_audited_rows(session)
    for model, expected in ((TeamRow, audited.teams), (TokenRow, audited.tokens), (PhaseRow, audited.phases)):
        rows = {row.id: row for row in session.scalars(select(model))}
        yield from _compare_ids(model.__tablename__, expected, rows)
        for name in expected.keys() & rows.keys():
            yield from _compare_columns(model.__tablename__, rows[name], expected[name])
    yield from _compare_webhooks(session, audited.webhooks)
    ids = session.scalars(select(SubmissionRow.id).order_by(SubmissionRow.created_us)).all()
    yield from _compare_ids("submissions", audited.submissions, dict.fromkeys(ids))
    for name in ids:
        if name in audited.submissions:
            row = session.get_one(SubmissionRow, name)
            yield from _compare_submission(row, audited.submissions[name])
            if with_results:
                yield from _compare_jobs(session, row, audited.submissions[name])
                yield from _compare_results(session, row)
            session.expunge(row)
    yield from _compare_standings(session)
    yield from _compare_cross_play(session, audited.cross_play)


def _compare_ids(table: str, expected: Mapping[str, Any], rows: Mapping[str, Any]) -> Iterator[RowDifference]:
    for name in expected:
        if name not in rows:
            yield RowDifference(table, name, "expected a row, as the audit log names it, found none")
    for name in rows:
        if name not in expected:
            yield RowDifference(table, name, "expected an entry of the audit log, found none")


def _compare_columns(table: str, row: Any, expected: Columns) -> Iterator[RowDifference]:
    for column, value in expected.items():
        actual = getattr(row, column, value)
        if actual != value:
            text = f"{column}: expected {format_leaf(value)}, found {format_leaf(actual)}"
            yield RowDifference(table, row.id, text)


def _compare_submission(row: SubmissionRow, expected: Columns) -> Iterator[RowDifference]:
    apart = ("state", "summary_sha256", "jobs_sha256")
    fixed = {column: value for column, value in expected.items() if column not in apart}
    yield from _compare_columns("submissions", row, fixed)
    state = expected["state"]
    if row.state != state and not (state is None and row.state in UNFINISHED):
        text = f"state: expected {state or 'queued or running'}, found {format_leaf(row.state)}"
        yield RowDifference("submissions", row.id, text)
    checksum = audit.compute_checksum(row.summary) if row.summary is not None else None
    if checksum != expected["summary_sha256"]:
        text = f"summary: expected the checksum {expected['summary_sha256']}, found {checksum}"
        yield RowDifference("submissions", row.id, text)


def _compare_webhooks(session: Session, expected: Mapping[str, Columns]) -> Iterator[RowDifference]:
    rows = {row.team: row for row in session.scalars(select(WebhookRow))}
    yield from _compare_ids("webhooks", expected, rows)
    for team in expected.keys() & rows.keys():
        row = rows[team]
        actual = {"created_us": row.created_us} | webhooks.compute_webhook_checksums(row.url, row.secret)
        for column, value in expected[team].items():
            if actual[column] != value:
                yield RowDifference("webhooks", team, f"{column}: expected {value}, found {actual[column]}")


def _compare_jobs(session: Session, row: SubmissionRow, expected: Columns) -> Iterator[RowDifference]:
    """Compare which scenarios and seeds a submission is driven in: without its worst ones its score would be better."""
    own = JobRow.is_of(row.id), JobRow.others == row.id
    jobs = session.execute(select(JobRow.scenario, JobRow.seed).where(*own))
    checksum = audit.compute_jobs_checksum((scenario, seed) for scenario, seed in jobs)
    if checksum != expected["jobs_sha256"]:
        text = f"scenarios and seeds: expected the checksum {expected['jobs_sha256']}, found {checksum}"
        yield RowDifference("jobs of submission", row.id, text)


def _compare_results(session: Session, row: SubmissionRow) -> Iterator[RowDifference]:
    """Compare the results of a submission's scenarios with the checksum in its summary, unless they were deleted."""
    if row.summary is None:
        return
    expected = row.summary["results_sha256"]
    jobs = select(JobRow).where(JobRow.is_of(row.id)).order_by(JobRow.scenario, JobRow.seed)
    finished = session.scalars(jobs).all()
    if not all(job.result is None for job in finished):
        checksum = audit.compute_results_checksum(finished)
        if checksum != expected:
            text = f"results of its scenarios: expected the checksum {expected}, found {checksum}"
            yield RowDifference("jobs of submission", row.id, text)
    yield from _compare_overviews(session, row.id, finished)
    for job in finished:
        session.expunge(job)


def _compare_overviews(session: Session, submission: str, jobs: Sequence[JobRow]) -> Iterator[RowDifference]:
    """Compare what lists show of results with the results."""
    shown = select(JobOverviewRow.job, JobOverviewRow.data).where(JobOverviewRow.submission == submission)
    data_by_job = {each.job: each.data for each in session.execute(shown)}
    for job in jobs:
        if job.result is None:
            continue
        if data_by_job.get(job.id) != overviews.make_overview(job.result, job.usage):
            text = "expected the overview of its result, found another or none"
            yield RowDifference("job_overviews", f"{submission} {job.scenario} {job.seed}", text)


def _compare_cross_play(session: Session, expected: Mapping[str, Sequence[Columns]]) -> Iterator[RowDifference]:
    """Compare the results of finished pairs with the log's, which tells no evaluators apart: in the order of ending."""
    done = select(JobRow, SubmissionRow.phase).join(SubmissionRow, SubmissionRow.id == JobRow.submission)
    done = done.where(JobRow.kind == JobKind.CROSS_PLAY, JobRow.state == JobState.DONE)
    results: dict[str, list[Columns | None]] = {}
    for row, phase in session.execute(done.order_by(JobRow.finished_us, JobRow.id)):
        results.setdefault(name_pair(phase, row.submission, row.others, row.scenario), []).append(row.result)
    yield from _compare_ids("jobs of cross-play", expected, results)
    for name in expected.keys() & results.keys():
        if list(expected[name]) != results[name]:
            text = f"result: expected {format_leaf(list(expected[name]))}, found {format_leaf(results[name])}"
            yield RowDifference("jobs of cross-play", name, text)


def _compare_standings(session: Session) -> Iterator[RowDifference]:
    """Compare the leaderboards with the submissions that they are made of."""
    public = {phase.id: phase.public for phase in session.scalars(select(PhaseRow))}
    expected = _compute_best(session, public)
    rows = {_key(row): row for row in session.scalars(select(StandingRow))}
    for key in expected.keys() | rows.keys():
        place = " ".join(key[:5])
        if key not in rows:
            yield RowDifference("standings", place, f"expected submission {expected[key][0].submission}, found no row")
        elif (row := rows[key]).submission not in {best.submission for best in expected.get(key, ())}:
            best = expected[key][0].submission if key in expected else "none"
            yield RowDifference("standings", place, f"submission: expected {best}, found {row.submission}")
        else:
            yield from _compare_standing(place, row, expected[key], public[row.phase])


def _compare_standing(
    place: str, row: StandingRow, candidates: Sequence[StandingRow], is_public: bool
) -> Iterator[RowDifference]:
    best = next(each for each in candidates if each.submission == row.submission)
    if standings.round_score(row.ds, is_public) != best.ds:
        yield RowDifference("standings", place, f"ds: expected {best.ds}, found {row.ds}")
    for column in ("figures", "method", "created_us"):
        if getattr(row, column) != getattr(best, column):
            value, actual = (format_leaf(getattr(each, column)) for each in (best, row))
            yield RowDifference("standings", place, f"{column}: expected {value}, found {actual}")


def _compute_best(session: Session, public: Mapping[str, bool]) -> dict[tuple[str, ...], list[StandingRow]]:
    """Return the standings of all done and shown submissions with the best score of each line, the earliest first."""
    done = select(SubmissionRow).where(SubmissionRow.state == SubmissionState.DONE, SubmissionRow.shown)
    best_by_key: dict[tuple[str, ...], list[StandingRow]] = {}
    ordered = done.order_by(SubmissionRow.created_us, SubmissionRow.id).execution_options(yield_per=100)
    for candidate in session.scalars(ordered):
        evaluator = standings.evaluator_digest(candidate.evaluator)
        for standing in standings.make_standings(candidate, evaluator, public.get(candidate.phase, False)):
            best = best_by_key.setdefault(_key(standing), [standing])
            if standing.ds > best[0].ds:
                best_by_key[_key(standing)] = [standing]
            elif standing.ds == best[0].ds and standing is not best[0]:
                best.append(standing)
    return best_by_key


def _key(row: StandingRow) -> tuple[str, ...]:
    return row.phase, row.slice, row.track, row.sensing_track, row.team, row.evaluator

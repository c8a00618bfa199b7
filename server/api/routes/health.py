"""Health check, Prometheus metrics, and verification of the audit log."""

from itertools import islice

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, generate_latest
from pydantic import Field

from mdrive_sumo import __version__
from server.api.dependencies import AdminCaller, Now, OperatorCaller, ServicesDep
from server.api.problems import document_problems
from server.api.schemas.parameters import ResponseModel
from server.enums import JobState, SubmissionState
from server.store import audit, queries, workers
from server.store.row_check import find_row_differences


class HealthOut(ResponseModel):
    """The server and its database answer."""

    status: str
    version: str


class AuditOut(ResponseModel):
    """Result of verifying the audit log's hash chain."""

    entries: int
    head: str
    broken: int | None
    """Id of the first entry whose hash does not fit the one before; null if all fit."""
    differences: list[str] = Field(default=[])
    """Rows that are not as the log says, at most 100; empty if the chain is broken."""


router = APIRouter(tags=["operations"])
MAX_DIFFERENCES = 100
"""Rows that `GET /audit` names at most: one changed column may differ in every row of a table."""
_TEXT = {"content": {"text/plain": {"schema": {"type": "string"}}}}


@router.get("/health", responses=document_problems())
async def health(services: ServicesDep) -> HealthOut:
    """Return 200 while the server and its database answer."""
    await services.run_health_check(services.store.version)
    return HealthOut(status="ok", version=__version__)


@router.get("/metrics", response_class=Response, responses=document_problems(401, 403) | {200: _TEXT})
def metrics(_caller: OperatorCaller, services: ServicesDep, at_us: Now) -> Response:
    """Metrics for Prometheus, with a token of an admin or a worker: job rates would disclose hidden scenarios."""
    with services.store.read() as session:
        of_submissions, of_jobs = queries.count_by_state(session)
        job_us = queries.mean_job_us(session)
        alive = workers.count_alive(session, services.settings.work.lease_s * 1_000_000, at_us)
        differences = audit.count_spot_check_differences(session)
    registry = CollectorRegistry()
    submissions = Gauge("mdrive_submissions", "Submissions by state", ["state"], registry=registry)
    jobs = Gauge("mdrive_jobs", "Jobs (scenario and seed) by state", ["state"], registry=registry)
    for state in SubmissionState:
        submissions.labels(state).set(of_submissions.get(state, 0))
    for state in JobState:
        jobs.labels(state).set(of_jobs.get(state, 0))
    duration = Gauge("mdrive_job_seconds", "Mean duration of the last jobs", registry=registry)
    duration.set(job_us / 1e6 if job_us is not None else float("nan"))
    Gauge("mdrive_workers", "Workers and dispatchers seen within a lease", registry=registry).set(alive)
    help_text = "Spot checks that found something else than before, since the beginning"
    Gauge("mdrive_spot_check_differences", help_text, registry=registry).set(differences)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


@router.get("/audit", responses=document_problems(401, 403))
def walk_audit_log(_caller: AdminCaller, services: ServicesDep) -> AuditOut:
    """Verify the whole hash chain of the audit log, and compare rows with it, without the results of scenarios."""
    with services.store.read() as session:
        chain = audit.verify_chain(session)
        rows = find_row_differences(session, with_results=False) if chain.broken is None else iter(())
        differences = [str(row) for row in islice(rows, MAX_DIFFERENCES)]
        return AuditOut(entries=chain.entries, head=chain.head, broken=chain.broken, differences=differences)

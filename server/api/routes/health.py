"""How the server is doing: for load balancers, for Prometheus, and for whoever doubts the audit log."""

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, generate_latest

from mdrive_sumo import __version__
from server.api import schemas
from server.api.dependencies import Admin, Now, ToolsOf, Watcher
from server.api.problems import documented
from server.enums import JobState, State
from server.store import audit, queries, workers

router = APIRouter(tags=["operations"])
_TEXT = {"content": {"text/plain": {"schema": {"type": "string"}}}}


@router.get("/health", responses=documented())
def health(using: ToolsOf) -> schemas.Health:
    """200 while the server and its database answer."""
    using.store.version()
    return schemas.Health(status="ok", version=__version__)


@router.get("/metrics", response_class=Response, responses=documented(401, 403) | {200: _TEXT})
def metrics(_caller: Watcher, using: ToolsOf, at_us: Now) -> Response:
    """For Prometheus, with a token of an admin or a worker: how fast jobs end tells about hidden scenarios."""
    with using.store.read() as session:
        of_submissions, of_jobs = queries.load(session)
        job_us = queries.job_us(session)
        alive = workers.alive(session, using.settings.work.lease_s * 1_000_000, at_us)
        differences = audit.spot_check_differences(session)
    registry = CollectorRegistry()
    submissions = Gauge("mdrive_submissions", "Submissions by state", ["state"], registry=registry)
    jobs = Gauge("mdrive_jobs", "Jobs (scenario and seed) by state", ["state"], registry=registry)
    for state in State:
        submissions.labels(state).set(of_submissions.get(state, 0))
    for state in JobState:
        jobs.labels(state).set(of_jobs.get(state, 0))
    duration = Gauge("mdrive_job_seconds", "Mean duration of the last jobs", registry=registry)
    duration.set(job_us / 1e6 if job_us is not None else float("nan"))
    Gauge("mdrive_workers", "Workers and dispatchers seen within a lease", registry=registry).set(alive)
    told = "Spot checks that found something else than before, since the beginning"
    Gauge("mdrive_spot_check_differences", told, registry=registry).set(differences)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


@router.get("/audit", responses=documented(401, 403))
def walk_audit_log(_caller: Admin, using: ToolsOf) -> schemas.Audit:
    """Walks the whole chain of the audit log."""
    with using.store.read() as session:
        found = audit.verify(session)
        return schemas.Audit(entries=found.entries, head=found.head, broken=found.broken)

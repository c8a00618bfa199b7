"""Phases: when submissions are taken, on what, and how many."""

from pathlib import Path

from fastapi import APIRouter

from server.api import schemas
from server.api.dependencies import Now, ServicesDep, TeamCaller
from server.api.problems import document_problems
from server.api.schemas import to_datetime
from server.store import phases, quota, tables

router = APIRouter(tags=["phases"])


@router.get("/phases", responses=document_problems())
def list_phases(using: ServicesDep, at_us: Now) -> schemas.PhasesOut:
    """All, in the order in which they open."""
    with using.store.read() as session:
        return schemas.PhasesOut(items=[_to_phase(each, at_us) for each in phases.list_phases(session)])


@router.get("/phases/{phase}", responses=document_problems(404, 422))
def show_phase(phase: schemas.PhaseId, using: ServicesDep, at_us: Now) -> schemas.PhaseOut:
    """One of them."""
    with using.store.read() as session:
        return _to_phase(phases.get(session, phase), at_us)


@router.get("/phases/{phase}/quota", responses=document_problems(401, 403, 404, 422))
def show_quota(phase: schemas.PhaseId, caller: TeamCaller, using: ServicesDep, at_us: Now) -> schemas.QuotaOut:
    """What the token's team has used of it."""
    with using.store.read() as session:
        used = quota.count_used(session, caller[1], phases.get(session, phase).id, at_us)
        return schemas.QuotaOut(today=used.today, in_parallel=used.in_parallel, in_total=used.in_total)


def _to_phase(phase: tables.PhaseRow, at_us: int) -> schemas.PhaseOut:
    """Not where the suite lies: that is a path of this machine, and the name of a hidden one says too much."""
    return schemas.PhaseOut(
        id=phase.id,
        title=phase.title,
        suite=Path(phase.suite).name if phase.public else None,
        public=phase.public,
        open=phase.opens_us <= at_us < phase.closes_us,
        opens=to_datetime(phase.opens_us),
        closes=to_datetime(phase.closes_us),
        per_day=phase.per_day,
        in_parallel=phase.in_parallel,
        in_total=phase.in_total,
        seeds=phase.seeds,
    )

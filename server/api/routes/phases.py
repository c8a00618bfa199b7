"""Phases: when submissions are taken, on what, and how many."""

from pathlib import Path

from fastapi import APIRouter

from server.api import schemas
from server.api.dependencies import Member, Now, ToolsOf
from server.api.problems import documented
from server.api.schemas import moment
from server.store import phases, quota, tables

router = APIRouter(tags=["phases"])


@router.get("/phases", responses=documented())
def list_phases(using: ToolsOf, at_us: Now) -> schemas.Phases:
    """All, in the order in which they open."""
    with using.store.read() as session:
        return schemas.Phases(items=[_shown(each, at_us) for each in phases.every(session)])


@router.get("/phases/{phase}", responses=documented(404, 422))
def show_phase(phase: schemas.PhaseId, using: ToolsOf, at_us: Now) -> schemas.Phase:
    """One of them."""
    with using.store.read() as session:
        return _shown(phases.get(session, phase), at_us)


@router.get("/phases/{phase}/quota", responses=documented(401, 403, 404, 422))
def show_quota(phase: schemas.PhaseId, caller: Member, using: ToolsOf, at_us: Now) -> schemas.Quota:
    """What the token's team has used of it."""
    with using.store.read() as session:
        used = quota.used(session, caller[1], phases.get(session, phase).id, at_us)
        return schemas.Quota(today=used.today, in_parallel=used.in_parallel, in_total=used.in_total)


def _shown(phase: tables.Phase, at_us: int) -> schemas.Phase:
    """Not where the suite lies: that is a path of this machine, and the name of a hidden one says too much."""
    return schemas.Phase(
        id=phase.id,
        title=phase.title,
        suite=Path(phase.suite).name if phase.public else None,
        public=phase.public,
        open=phase.opens_us <= at_us < phase.closes_us,
        opens=moment(phase.opens_us),
        closes=moment(phase.closes_us),
        per_day=phase.per_day,
        in_parallel=phase.in_parallel,
        in_total=phase.in_total,
        seeds=phase.seeds,
    )

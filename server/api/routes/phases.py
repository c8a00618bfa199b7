"""Phases: when submissions are accepted, on which suite, and how many."""

from collections.abc import Iterable
from pathlib import Path

from fastapi import APIRouter

from mdrive_sumo.scenario.season import read_stored_name
from server.api.dependencies import Now, ServicesDep, TeamCaller
from server.api.problems import document_problems
from server.api.schemas.parameters import PhaseId, to_datetime
from server.api.schemas.submissions import PhaseOut, PhasesOut, QuotaOut
from server.store import phases, quota, tables

router = APIRouter(tags=["phases"])


@router.get("/phases", responses=document_problems())
def list_phases(services: ServicesDep, at_us: Now) -> PhasesOut:
    """Return all phases in the order in which they open."""
    with services.store.read() as session:
        return PhasesOut(items=[_to_phase(each, at_us) for each in phases.list_phases(session)])


@router.get("/phases/{phase}", responses=document_problems(404, 422))
def show_phase(phase: PhaseId, services: ServicesDep, at_us: Now) -> PhaseOut:
    """Return one phase."""
    with services.store.read() as session:
        return _to_phase(phases.get(session, phase), at_us)


@router.get("/phases/{phase}/quota", responses=document_problems(401, 403, 404, 422))
def show_quota(phase: PhaseId, member: TeamCaller, services: ServicesDep, at_us: Now) -> QuotaOut:
    """Return what the token's team has used of the quota."""
    with services.store.read() as session:
        used = quota.count_used(session, member.team, phases.get(session, phase).id, at_us)
        return QuotaOut(today=used.today, in_parallel=used.in_parallel, in_total=used.in_total)


def find_default_phase(listed: Iterable[PhaseOut]) -> PhaseOut | None:
    """Return the phase for a first submission: the first open public one, never a hidden one, whose quota is small."""
    return next((phase for phase in listed if phase.open and phase.public), None)


def _to_phase(phase: tables.PhaseRow, at_us: int) -> PhaseOut:
    """Return the phase without its suite's path on this machine and, if it is hidden, without the suite's name."""
    return PhaseOut(
        id=phase.id,
        title=phase.title,
        suite=read_stored_name(Path(phase.suite).name) if phase.public else None,
        public=phase.public,
        open=phase.opens_us <= at_us < phase.closes_us,
        opens=to_datetime(phase.opens_us),
        closes=to_datetime(phase.closes_us),
        per_day=phase.per_day,
        in_parallel=phase.in_parallel,
        in_total=phase.in_total,
        seeds=phase.seeds,
        sensor_track_only=phase.sensor_track_only,
        cross_play_scenarios=phase.cross_play_scenarios,
    )

"""Phases: when submissions are accepted, on which suite, and how many."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.suggestion import describe_unknown
from server.clock import format_utc
from server.errors import NotFound, NotNow
from server.store import audit
from server.store.tables import PhaseRow


@dataclass(frozen=True, slots=True)
class NewPhase:
    """A phase of the settings file; the fields are those of `PhaseRow`."""

    id: str
    title: str
    suite: str
    public: bool
    opens_us: int
    closes_us: int
    per_day: int
    in_parallel: int
    in_total: int
    seeds: int = 1
    sensor_track_only: bool = False
    cross_play_scenarios: int = 0


def set_phases(session: Session, wanted: Iterable[NewPhase], now_us: int) -> None:
    """Create or update the phases of the settings; others stay, because they have submissions."""
    for new in wanted:
        old = session.get(PhaseRow, new.id)
        if old is not None and all(getattr(old, name) == value for name, value in asdict(new).items()):
            continue
        session.merge(PhaseRow(**asdict(new)))
        audit.add_entry(session, "admin", "phase-set", asdict(new), now_us)


def get(session: Session, phase_id: str) -> PhaseRow:
    """Return a phase. Raises NotFound, which lists the known ones."""
    phase = session.get(PhaseRow, phase_id)
    if phase is None:
        ids = [phase.id for phase in list_phases(session)]
        raise NotFound(f"phase: {describe_unknown(phase_id, ids or ['none'])}")
    return phase


def list_phases(session: Session) -> Sequence[PhaseRow]:
    """Return all phases in the order in which they open."""
    return session.scalars(select(PhaseRow).order_by(PhaseRow.opens_us, PhaseRow.id)).all()


def check_open(phase: PhaseRow, now_us: int) -> None:
    """Raise NotNow before the phase opens and after it closes."""
    if now_us < phase.opens_us:
        raise NotNow(f"phase {phase.id}: it opens at {format_utc(phase.opens_us)}")
    if now_us >= phase.closes_us:
        raise NotNow(f"phase {phase.id}: it closed at {format_utc(phase.closes_us)}")

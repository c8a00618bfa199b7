"""Flags submissions whose agents think either briefly or long: so they could send bits to other CAVs of a scenario.

The time of a request shows when the slowest answer before it arrived: docs/server-phases.md, "Timing between CAVs".
The flag is an entry of the audit log, which only organisers see.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.bimodality import is_bimodal
from server.store import audit
from server.store.tables import JobRow

FLAG_ACTION = "thinking-times"
"""Action of the entries in the audit log."""
THINKING = "thinking"
"""Key in `JobRow.usage`, which overviews leave out."""


@dataclass(frozen=True, slots=True)
class ThinkingFlag:
    """What is conspicuous in the thinking times of a submission."""

    agents: int
    """Agents of all scenarios and seeds; a joint agent counts once for each."""
    bimodal: int
    """How many of these agents have times that fall into two groups."""
    late: int
    """Answers that took longer than the pace, by which the next requests were late."""
    widest: Mapping[str, float]
    """The groups with the largest D of Ashman, as `describe_modes` returns them; empty if none is bimodal."""

    @property
    def text(self) -> str:
        """The flag in a sentence."""
        parts = [f"{self.bimodal} of {self.agents} agents answer in two groups of times"]
        if self.widest:
            low, high, share = (self.widest[name] for name in ("low_ms", "high_ms", "high_share"))
            parts.append(
                f"the widest are {low:g} ms and {high:g} ms ({share:.0%} of the ticks), D {self.widest['d']:g}"
            )
        if self.late:
            parts.append(f"{self.late} answers took longer than the pace")
        return "; ".join(parts)


def find_thinking_flag(usages: Iterable[Mapping[str, Any] | None]) -> ThinkingFlag | None:
    """Return the flag of a submission's jobs, None if nothing is conspicuous."""
    agents = [times for usage in usages for times in ((usage or {}).get(THINKING) or {}).values()]
    bimodal: list[Mapping[str, float]] = [times["modes"] for times in agents if is_bimodal(times["modes"])]
    late = sum(times["late"] or 0 for times in agents)
    if not bimodal and not late:
        return None
    return ThinkingFlag(len(agents), len(bimodal), late, max(bimodal, key=itemgetter("d"), default={}))


def record_thinking_flag(session: Session, submission: str, now_us: int) -> None:
    """Write the flag of a finished submission to the audit log, if there is one."""
    flag = find_thinking_flag(session.scalars(select(JobRow.usage).where(JobRow.is_of(submission))))
    if flag is not None:
        entry = {"submission": submission, "bimodal": flag.bimodal, "agents": flag.agents, "late": flag.late}
        audit.add_entry(session, "server", FLAG_ACTION, entry | {"text": flag.text}, now_us)

"""What the audit log says about rows of other tables: the state that its entries lead to."""

from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.enums import SubmissionState
from server.store.tables import AuditEntryRow

Columns = dict[str, Any]
"""Expected values by name of the column."""
_PREFIX = "submission-"
_COPIED = ("archive_sha256", "phase", "evaluator", "track", "name", "environment", "counts", "jobs_sha256")
"""Columns of a submission that its entries repeat, and a checksum of its jobs where they were queued."""
_PAIR = ("phase", "tested", "others", "scenario")
_UNFINISHED: Columns = {"state": None, "ds": None, "summary_sha256": None}


@dataclass
class AuditedRows:
    """Expected columns of each row, by id."""

    teams: dict[str, Columns] = field(default_factory=lambda: {})
    tokens: dict[str, Columns] = field(default_factory=lambda: {})
    phases: dict[str, Columns] = field(default_factory=lambda: {})
    webhooks: dict[str, Columns] = field(default_factory=lambda: {})
    """By team, with checksums of address and secret."""
    submissions: dict[str, Columns] = field(default_factory=lambda: {})
    """`state` is None while a submission is unfinished."""
    cross_play: dict[str, list[Columns]] = field(default_factory=lambda: {})
    """Results by `name_pair`, in the order of the log: one for each evaluator under which the pair was driven."""

    def apply(self, entry: AuditEntryRow) -> None:
        """Take over what an entry says; actions without a row say nothing."""
        if entry.action.startswith(_PREFIX):
            self._apply_submission(entry, entry.action.removeprefix(_PREFIX))
            return
        data, at_us = entry.data, entry.at_us
        match entry.action:
            case "team-created":
                self.teams[data["team"]] = {"name": data["name"], "created_us": at_us, "hidden": False}
            case "team-hidden" | "team-shown":
                self.teams.setdefault(data["team"], {})["hidden"] = entry.action == "team-hidden"
            case "token-issued":
                issued = {name: data[name] for name in ("team", "scope", "hash")}
                self.tokens[data["token"]] = issued | {"created_us": at_us, "revoked_us": None}
            case "token-revoked":
                self.tokens.setdefault(data["token"], {})["revoked_us"] = at_us
            case "phase-set":
                self.phases[data["id"]] = dict(data)
            case "webhook-set":
                checksums = {name: data[name] for name in ("url_sha256", "secret_sha256")}
                self.webhooks[data["team"]] = {"created_us": at_us} | checksums
            case "webhook-removed":
                self.webhooks.pop(data["team"], None)
            case "cross-play-done":
                result = {name: value for name, value in data.items() if name not in _PAIR}
                self.cross_play.setdefault(name_pair(*(data[name] for name in _PAIR)), []).append(result)
            case _:
                pass

    def _apply_submission(self, entry: AuditEntryRow, action: str) -> None:
        data = entry.data
        row = self.submissions.setdefault(data["submission"], dict(_UNFINISHED))
        row |= {name: data[name] for name in _COPIED if name in data}
        if action in ("accepted", "rerun"):
            row |= {"created_us": entry.at_us, "shown": action == "accepted", "team": self._find_team(entry)}
        elif action == "renewed":
            row |= _UNFINISHED
        elif action == "shown":
            row["shown"] = data["shown"]
        elif action in set(SubmissionState):
            row |= {"state": action, "finished_us": entry.at_us, "why": data.get("why", "")}
            row |= {name: data[name] for name in ("ds", "summary_sha256") if name in data}

    def _find_team(self, entry: AuditEntryRow) -> str | None:
        if entry.action.endswith("rerun"):
            return self.submissions.get(entry.data.get("of", ""), {}).get("team")
        return entry.actor.removeprefix("team:")


def load_audited_rows(session: Session) -> AuditedRows:
    """Return the state that the whole log leads to; the log itself is verified by `audit.verify_chain`."""
    rows = AuditedRows()
    for entry in session.scalars(select(AuditEntryRow).order_by(AuditEntryRow.id).execution_options(yield_per=500)):
        rows.apply(entry)
    return rows


def name_pair(phase: str, tested: str, others: str, scenario: str) -> str:
    """Return the name of a cross-play job in messages."""
    return f"{phase} {tested} among {others} in {scenario}"

"""What became of the cars of a scenario, in a few words for a table: outcomes, infractions, whether all succeeded."""

from collections import Counter
from collections.abc import Sequence

from mdrive_sumo.core.state import End
from server.api.schemas.scenarios import EgoOut, ScenarioOut
from server.enums import ScenarioVerdict

FAILURES = "failures"
"""Filter for scenarios with a failure: see `has_failure`."""

OUTCOMES = frozenset((*(end.value for end in End), "route-deviation"))
"""Kinds of infractions that only mark how a car ended."""


def has_failure(row: ScenarioOut) -> bool:
    """Return whether a scenario has a result in which not every car arrived without a penalty, or none by our fault."""
    return row.verdict is not None and not is_success(row)


def is_success(row: ScenarioOut) -> bool:
    """Return whether every car arrived without a penalty and no agent failed."""
    return row.verdict == ScenarioVerdict.OK and row.sr == 100.0


def match_filter(row: ScenarioOut, wanted: str) -> bool:
    """Return whether a row is shown: `wanted` is "" for all, `FAILURES`, a verdict, or a state."""
    return not wanted or wanted in (row.verdict, row.state) or (wanted == FAILURES and has_failure(row))


def describe_outcomes(row: ScenarioOut) -> str:
    """Return how the cars ended: "arrived" for one car, "2 arrived, 1 blocked" for several; "" without a result."""
    counts = Counter(ego.outcome for ego in row.egos or ())
    order = [*(end.value for end in End), *sorted(counts)]
    ordered = sorted(counts.items(), key=lambda pair: order.index(pair[0]))
    if len(row.egos or ()) == 1:
        return ordered[0][0]
    return ", ".join(f"{count} {outcome}" for outcome, count in ordered)


def grade_outcome(row: ScenarioOut) -> str:
    """Return the CSS class of a tag: good only for a success."""
    if row.verdict == ScenarioVerdict.AGENT_FAILED:
        return "bad"
    return "good" if is_success(row) else "warn"


def describe_infractions(egos: Sequence[EgoOut] | None) -> str:
    """Return the infractions of the cars by kind: "2 x collision-vehicle, stop-sign"; "none", "" without a result.

    Marks of an outcome (blocked, timed-out, ...) are left out: `describe_outcomes` has them.
    """
    if not egos:
        return ""
    counts = Counter(str(each["kind"]) for ego in egos for each in ego.infractions if each["kind"] not in OUTCOMES)
    words = [kind if count == 1 else f"{count} x {kind}" for kind, count in sorted(counts.items())]
    if left_out := sum(ego.infractions_left_out for ego in egos):
        words.append(f"{left_out} more")
    return ", ".join(words) or "none"

"""Labels of a run: what kind of agent drove, derived from what it declared and what it did, never from what it says."""

from collections.abc import Collection, Iterable, Sequence

from mdrive_sumo.scoring.results import ScenarioResult
from mdrive_sumo.v2x.content import CAM, CPM, DENM, FEATURE

SINGLE, SHARING, NEGOTIATION = "single", "sharing", "negotiation"
COMMUNICATION_LABELS = (SINGLE, SHARING, NEGOTIATION)
"""What the CAVs of a run exchanged: nothing; CAMs, CPMs, DENMs and features; anything else."""
JOINT, PRIVILEGED, UNSANDBOXED = "joint", "privileged", "unsandboxed"
"""One program for all CAVs; a sensor that knows everything; a third-party agent that could read the scenarios."""
ATTACKED = "attacked"
"""Stations lied (`--attack`): such results say nothing about honest ones."""
SHARING_TYPES = frozenset((CAM, CPM, DENM, FEATURE))


def derive_labels(facts: Sequence[str], scenarios: Iterable[ScenarioResult]) -> tuple[str, ...]:
    """Return the labels of a run: one about communication, then the given facts (`joint`, `privileged`, ...).

    A joint agent has no label about communication, because no channel limits it. Nor has a privileged agent that
    exchanges nothing: it is not alone, for it sees the states and plans of all.
    """
    kept = tuple(fact for fact in facts if fact not in COMMUNICATION_LABELS)
    label = derive_communication_label({kind for scenario in scenarios for kind in scenario.exchanged})
    if JOINT in kept or (PRIVILEGED in kept and label == SINGLE):
        return kept
    return (label, *kept)


def derive_communication_label(types: Collection[str]) -> str:
    """Return the label for the types of message that CAVs exchanged.

    A type of the agents' own counts as negotiation, as in the tracks of a challenge: it can carry anything.
    """
    if not types:
        return SINGLE
    return SHARING if SHARING_TYPES.issuperset(types) else NEGOTIATION

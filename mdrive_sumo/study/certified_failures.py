"""Whether CAVs fail as their certificates of need say: in the conflict that is certified, or by the time limit."""

from collections import Counter
from collections.abc import Iterable, Mapping
from enum import StrEnum

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import End
from mdrive_sumo.core.tables import Table, make_text_table
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.scoring.metrics.endings import LATE_KINDS
from mdrive_sumo.study.need.conflict_zone import MAX_LENGTH_M
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedConflict, Proof

NEAR_M = MAX_LENGTH_M + 3.0
"""A collision so near the begin of a conflict zone is in it: a zone's greatest length, and half a car."""


class DriveEnd(StrEnum):
    """How the drive of a CAV ends about which something is certified."""

    CERTIFIED = "certified conflict"
    """Its first costly infraction is a collision with the road user of a certified conflict, or with another one of the
    same stream, there."""
    LATE = "late"
    """No costly infraction but that it does not arrive."""
    ELSEWHERE = "elsewhere"
    """Its first costly infraction is another one."""
    MET = "safe and in time"
    """It arrives without a costly infraction: its driver had messages, or met the one start of the scenario."""


def judge_drive(result: EgoResult, certificate: NeedCertificate, streams: Mapping[str, str]) -> DriveEnd | None:
    """Return how a CAV's drive ends; None if the certificate proves nothing about that CAV.

    streams: name of the stream by the id of each road user that is in one.
    """
    conflicts = [conflict for conflict in certificate.conflicts if conflict.ego == result.id]
    if not conflicts:
        return None
    costly = (one for one in result.infractions if one.factor < 1.0 and one.kind not in LATE_KINDS)
    first = min(costly, key=lambda one: one.tick, default=None)
    if first is None:
        return DriveEnd.MET if result.outcome is End.ARRIVED else DriveEnd.LATE
    return DriveEnd.CERTIFIED if any(_is_at(first, conflict, streams) for conflict in conflicts) else DriveEnd.ELSEWHERE


def _is_at(infraction: Infraction, conflict: NeedConflict, streams: Mapping[str, str]) -> bool:
    gap_m = float(portable.hypot(infraction.x - conflict.x, infraction.y - conflict.y))
    met, certified = (streams.get(name, name) for name in (infraction.other, conflict.road_user))
    return met == certified and gap_m <= NEAR_M


def build_failure_table(
    results: Iterable[ScenarioResult], need: Mapping[str, NeedCertificate], scenarios: Iterable[Scenario]
) -> Table | None:
    """Return how many drives of certified CAVs end in each way, by what is proven of the scenario; None without any.

    scenarios: of the suite; they say which road users come in one stream, of which a certificate names one.
    """
    streams = {one.id: {actor.id: actor.stream for actor in one.actors if actor.stream} for one in scenarios}
    counts = {proof: Counter[DriveEnd]() for proof in Proof}
    for result in results:
        certificate = need.get(result.id)
        if certificate is None or certificate.proves is None:
            continue
        ends = (judge_drive(ego, certificate, streams.get(result.id, {})) for ego in result.egos)
        counts[certificate.proves].update(end for end in ends if end is not None)
    rows = [
        (str(proof), str(found.total()), *(str(found[end]) for end in DriveEnd))
        for proof, found in counts.items()
        if found
    ]
    return make_text_table(("certificate proves", "drives of its CAVs", *DriveEnd), rows) if rows else None

"""Why each CAV lost score, in plain English: one line per CAV, of one part per infraction or ending."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, End, FailureReason
from mdrive_sumo.report.reasons import NotedReason
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.scoring.criteria import BLOCKED_TICKS
from mdrive_sumo.scoring.score_mode import SUCCESS_DS

MAX_REASON = 200
"""Characters of a failed agent's message; its log has all of it."""
REASONED = ("collision-vehicle", "collision-pedestrian", "collision-static", "blocked", "timed-out")
"""Kinds of losses for which a reader asks why the CAV drove, or did not drive, at that time."""
ENDINGS: Mapping[str, str] = {
    "blocked": f"stood still for {BLOCKED_TICKS // TICKS_PER_SECOND} s",
    "route-deviation": "left its route",
    "timed-out": "ran out of time",
}


@dataclass(frozen=True, slots=True)
class Loss:
    """One reason for lost score."""

    kind: str
    """Kind of the infraction, e.g. "collision-vehicle"."""
    text: str
    tick: int
    factor: float
    """What it multiplies the driving score by; 1 if it costs route completion instead."""

    @property
    def time_s(self) -> float:
        """When it happened [s]."""
        return self.tick * DT


@dataclass(frozen=True, slots=True)
class CavLosses:
    """What one CAV of an episode lost."""

    ego: str
    outcome: End
    ds: float
    losses: tuple[Loss, ...]
    """In the order of their ticks; empty if no infraction says why, as in scores of another mode."""

    @property
    def has_failed_agent(self) -> bool:
        """Whether its agent failed."""
        return self.outcome is End.AGENT_FAILED


def explain_losses(
    result: ScenarioResult, route_lengths: Mapping[str, float], reasons: Sequence[NotedReason] = ()
) -> tuple[CavLosses, ...]:
    """Return what each CAV that did not succeed lost, the worst first: those with a DS of at most `SUCCESS_DS`.

    route_lengths: of each CAV by its id [m]; of a CAV without one no metres are named. reasons: of all CAVs, in order;
    with each loss of a kind in `REASONED` stands the one that held.
    """
    cavs = {ego.id for ego in result.egos}
    score = {ego.id: ego.ds * (1.0 if ego.time_factor is None else ego.time_factor) for ego in result.egos}
    lost = [ego for ego in result.egos if score[ego.id] <= SUCCESS_DS]
    return tuple(
        CavLosses(
            ego.id,
            ego.outcome,
            score[ego.id],
            tuple(_add_reason(loss, ego.id, reasons) for loss in list_losses(ego, cavs, route_lengths.get(ego.id))),
        )
        for ego in sorted(lost, key=lambda ego: score[ego.id])
    )


def _add_reason(loss: Loss, ego: str, reasons: Sequence[NotedReason]) -> Loss:
    held = [reason for reason in reasons if reason.ego == ego and reason.tick <= loss.tick]
    if loss.kind not in REASONED or not held:
        return loss
    return replace(loss, text=f"{loss.text} (noted: {held[-1].text})")


def list_losses(ego: EgoResult, cavs: set[str], route_m: float | None) -> tuple[Loss, ...]:
    """Return what one CAV lost; cavs: ids of all; route_m: length of its route [m], None if metres are not named."""
    events = sorted(ego.infractions, key=lambda event: event.tick)
    losses = [Loss(event.kind, _describe(event, ego, cavs, route_m), event.tick, event.factor) for event in events]
    if ego.time_factor is not None and ego.time_factor < 1.0:
        losses.append(Loss("time", _describe_time(ego), ego.ticks or 0, ego.time_factor))
    return tuple(losses)


def _describe_time(ego: EgoResult) -> str:
    """Describe what mode `hard` takes off for time."""
    if ego.outcome is End.ARRIVED and ego.ip >= 1.0 and ego.time_ratio is not None:
        return f"needed {ego.time_ratio:.2f} x omniscient's time"
    reason = "with an infraction" if ego.outcome is End.ARRIVED else "without arrival"
    return f"counts with its whole time limit, {reason}"


LEFT = f"{FailureReason.LEFT}: "
"""How the reason of a CAV begins whose person has left: what follows is a sentence."""


def _describe(event: Infraction, ego: EgoResult, cavs: set[str], route_m: float | None) -> str:
    if event.kind in ENDINGS:
        return f"{ENDINGS[event.kind]}, {_describe_progress(ego, route_m)}"
    if event.kind == "agent-failed":
        short = truncate(" ".join(ego.reason.split()), MAX_REASON)
        what = short.removeprefix(LEFT) if short.startswith(LEFT) else f"agent failed ({short})"
        return f"{what}, {_describe_progress(ego, route_m)}"
    if event.kind.startswith("collision-"):
        speed = "" if event.impact_speed is None else f" at {event.impact_speed:.1f} m/s"
        return f"hit {_name_other(event, cavs)}{speed}"
    if event.kind == "red-light":
        return f"crossed the stop line at red (light {event.other})"
    if event.kind == "stop-sign":
        return f"did not stop at stop sign {event.other}"
    if event.kind == "outside-lanes":
        return _describe_outside(1.0 - event.factor, ego, route_m)
    if event.kind == "speeding" and ego.speeding is not None:
        return (
            f"drove more than 10 % above the speed limit for {ego.speeding.share:.0f} % of its time,"
            f" at most {ego.speeding.greatest:.1f} m/s above it"
        )
    return f"{event.kind}{f' with {event.other}' if event.other else ''}"


def _name_other(event: Infraction, cavs: set[str]) -> str:
    if event.other in cavs:
        return f"CAV {event.other}"
    if not event.other:
        return "a building"
    name = {"collision-static": "obstacle", "collision-pedestrian": "pedestrian"}.get(event.kind, "vehicle")
    return f"{name} {event.other}"


def _describe_outside(share: float, ego: EgoResult, route_m: float | None) -> str:
    """share: of the distance driven."""
    metres = "" if route_m is None else f" ({share * route_m * ego.rc / 100:.0f} m)"
    return f"drove {100 * share:.0f} % of its way{metres} outside lanes or on a wrong lane"


def _describe_progress(ego: EgoResult, route_m: float | None) -> str:
    if route_m is None:
        return f"with {ego.rc:.0f} % of its route done"
    return f"{route_m * (1 - ego.rc / 100):.0f} m before the end of its route ({ego.rc:.0f} % done)"

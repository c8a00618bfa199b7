"""Validation of an agent's Reply."""

import math
import re
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from mdrive_sumo.contract.exchange import Control, Message, Note, Plan, Reply
from mdrive_sumo.contract.sensors import Detections
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float

MAX_PLAN_POINTS, MAX_DETECTIONS, MAX_MESSAGES = 200, 1000, 64
"""In one reply. Chosen: 200 points are 10 s in steps of a tick; all bound the work of the evaluator for a tick."""
MAX_NOTES = 200_000
"""Characters in the notes of one reply."""
NAME = re.compile(r"[a-z0-9_-]{1,16}")
"""Types of messages and kinds of notes."""
FARTHEST_M = 1e6
"""Largest coordinate [m], either sign."""
CONTROL_STEP = 1e-4
"""Controls are rounded to this step on arrival, so that the recorded action log re-executes exactly."""


class ReplyError(ValueError):
    """An agent's answer is not a valid Reply."""


def check_reply(reply: object, controllers: frozenset[str]) -> Reply:
    """Return the reply with its control rounded to `CONTROL_STEP`. Raises ReplyError that names the first problem."""
    if not isinstance(reply, Reply):
        remedy = "; return Reply(control=Control(throttle, brake, steer))" if isinstance(reply, Mapping) else ""
        raise ReplyError(f"expected a Reply, found {type(reply).__name__}{remedy}")
    if (reply.control is None) == (reply.plan is None):
        raise ReplyError("expected either a control or a plan, found " + ("neither" if reply.plan is None else "both"))
    attachments = _check_messages(reply.messages), _check_notes(reply.notes), _check_detections(reply.detections)
    if reply.control is not None:
        return build_frozen(Reply, _check_control(reply.control), None, *attachments)
    return build_frozen(Reply, None, _check_plan(reply.plan, controllers), *attachments)


def _check_messages(messages: Any) -> tuple[Message, ...]:
    if not isinstance(messages, tuple) or len(messages) > MAX_MESSAGES:
        raise ReplyError(f"messages: expected a tuple of at most {MAX_MESSAGES}, found {_describe_count(messages)}")
    for message in messages:
        if not isinstance(message, Message) or not isinstance(cast(object, message.payload), bytes):
            raise ReplyError(f"messages: expected Message with a bytes payload, found {type(message).__name__}")
        if not isinstance(cast(object, message.type), str) or not NAME.fullmatch(message.type):
            raise ReplyError(f"messages: type: expected 1 to 16 of a-z, 0-9, _ and -, found {message.type!r:.40}")
    return messages


def _check_notes(notes: Any) -> tuple[Note, ...]:
    if not isinstance(notes, tuple):
        raise ReplyError(f"notes: expected a tuple, found {_describe_count(notes)}")
    size = 0
    for note in notes:
        if not isinstance(note, Note) or not isinstance(cast(object, note.text), str):
            raise ReplyError(f"notes: expected Note with a text, found {type(note).__name__}")
        if not isinstance(cast(object, note.kind), str) or not NAME.fullmatch(note.kind):
            raise ReplyError(f"notes: kind: expected 1 to 16 of a-z, 0-9, _ and -, found {note.kind!r:.40}")
        size += len(note.text)
    if size > MAX_NOTES:
        raise ReplyError(f"notes: expected at most {MAX_NOTES} characters a tick, found {size}")
    return notes


def _check_detections(detections: object) -> Detections | None:
    if detections is None:
        return None
    if not isinstance(detections, Detections):
        raise ReplyError(f"detections: expected Detections or None, found {type(detections).__name__}")
    try:
        boxes = np.array(detections.boxes, dtype=np.float64)
        scores = np.array(detections.scores, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ReplyError("detections: expected numbers for boxes and scores") from None
    if boxes.ndim != 2 or boxes.shape[1] != 5 or scores.shape != (len(boxes),) or len(boxes) > MAX_DETECTIONS:
        raise ReplyError(
            f"detections: expected boxes (0..{MAX_DETECTIONS}, 5) and as many scores, found {boxes.shape} and "
            f"{scores.shape}"
        )
    if not are_within(boxes, FARTHEST_M) or (boxes[:, 3:] <= 0.0).any():
        raise ReplyError("detections: expected finite boxes of positive size within 1000 km of the origin")
    if not ((scores >= 0.0) & (scores <= 1.0)).all():  # NaN fails too
        raise ReplyError("detections: expected scores in [0, 1]")
    return Detections(boxes, scores)


def _describe_count(value: object) -> str:
    return f"{len(value)}" if isinstance(value, tuple) else type(value).__name__


def _check_control(control: object) -> Control:
    if not isinstance(control, Control):
        raise ReplyError(f"expected a Control, found {type(control).__name__}")
    return Control(
        throttle=_check_range("throttle", control.throttle, 0.0),
        brake=_check_range("brake", control.brake, 0.0),
        steer=_check_range("steer", control.steer, -1.0),
    )


def _check_range(name: str, value: Any, low: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ReplyError(f"{name}: expected a number, found {type(value).__name__}") from None
    if not low <= number <= 1.0:  # NaN fails too
        raise ReplyError(f"{name}: expected a number in [{low:g}, 1], found {number}")
    return round(round(number / CONTROL_STEP) * CONTROL_STEP, 4)


def _check_plan(plan: object, controllers: frozenset[str]) -> Plan:
    if not isinstance(plan, Plan):
        raise ReplyError(f"expected a Plan, found {type(plan).__name__}")
    try:
        points = np.array(plan.points, dtype=np.float64)
        interval_s = float(plan.interval_s)
    except (TypeError, ValueError, OverflowError):
        raise ReplyError("plan: expected numbers for points and interval_s") from None
    if points.ndim != 2 or points.shape[1] != 2 or not 1 <= len(points) <= MAX_PLAN_POINTS:
        raise ReplyError(f"plan: expected points of shape (1..{MAX_PLAN_POINTS}, 2), found {points.shape}")
    if not are_within(points, FARTHEST_M):
        raise ReplyError("plan: expected finite points within 1000 km of the origin")
    if not (math.isfinite(interval_s) and 0.01 <= interval_s <= 10.0):
        raise ReplyError(f"plan: expected interval_s in [0.01, 10] s, found {interval_s}")
    if not isinstance(cast(object, plan.controller), str) or plan.controller not in controllers:
        raise ReplyError(f"plan: unknown controller {plan.controller!r}, expected one of {sorted(controllers)}")
    return build_frozen(Plan, points, interval_s, plan.controller)


@twin
def are_within(values: Float, limit: float, /) -> bool:
    """Return whether all values are numbers of at most that size, either sign."""
    return bool((np.abs(values) <= limit).all())  # NaN fails too

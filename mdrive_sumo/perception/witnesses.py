"""What other senders see of the claims of one: two of them, of which none is proven to lie, refute what the own car
cannot see.

One witness is not enough: a sender that lies about its free view would accuse honest ones of phantoms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT
from mdrive_sumo.perception.free_view import find_near, find_seen_through
from mdrive_sumo.v2x.messages import Cam, Cpm, ReferencePose

LEAST_WITNESSES = 2
"""More than one liar among the senders can outvote an honest one; a single liar cannot."""


@dataclass(frozen=True, slots=True)
class Witness:
    """A sender that is believed, and what it sees."""

    pose: ReferencePose
    """Where it was when its view was taken."""
    free_m: Float
    """(B,) as `Objects.free_m`."""
    objects: Objects
    """What it detected, at the time of the own view."""


def make_witness(cpm: Cpm, cam: Cam | None, objects: Objects, latency_ticks: int) -> Witness:
    """Return the sender of a CPM as a witness.

    cam: its newest one, whose speed tells where it was `latency_ticks` before; None: it stands, as a road-side unit.
    """
    back_m = 0.0 if cam is None else cam.speed * latency_ticks * DT
    cos, sin = portable.cos_sin(cpm.pose.yaw)
    pose = replace(cpm.pose, x=cpm.pose.x - back_m * cos, y=cpm.pose.y - back_m * sin)
    return Witness(pose, cpm.objects.free_m, objects)


def find_refuted_by_others(
    boxes: Objects, sigmas: Float, senders: Sequence[str], witnesses: Mapping[str, Witness]
) -> Bool:
    """Return an (N,) mask of the boxes that `LEAST_WITNESSES` see through, and near which no witness has a detection.

    boxes: such as end a view (`find_opaque`). sigmas: (N,) standard deviation [m] of each coordinate. senders: who
    reports each box, and is no witness of it.
    """
    refuted, rows = np.zeros(len(boxes), dtype=np.bool_), np.arange(len(boxes))
    if len(witnesses) < LEAST_WITNESSES or not len(rows):
        return refuted
    is_supported = np.zeros(len(rows), dtype=np.bool_)
    for name, witness in witnesses.items():
        is_supported |= _find_others(name, senders, rows) & find_near(boxes.take(rows), witness.objects)
    rows = rows[~is_supported]  # views cost more than detections, and most boxes are supported
    if not len(rows):
        return refuted
    parts, count = boxes.take(rows), np.zeros(len(rows), dtype=np.int64)
    for name, witness in witnesses.items():
        is_seen_through = find_seen_through(parts, sigmas[rows], witness.pose, witness.free_m)
        count += _find_others(name, senders, rows) & is_seen_through
    refuted[rows] = count >= LEAST_WITNESSES
    return refuted


def _find_others(name: str, senders: Sequence[str], rows: Int) -> Bool:
    """Return a mask of the rows whose sender is another one than a witness."""
    return np.array([senders[row] != name for row in rows.tolist()], dtype=np.bool_)

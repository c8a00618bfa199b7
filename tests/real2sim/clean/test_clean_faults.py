"""Planted faults are repaired, and none silently."""

from collections import Counter
from collections.abc import Iterable

import numpy as np
import pytest
from testing.log_faults import PLANTS, Fault, planted, tracks_of
from testing.log_truth import Log, alone, observed, truth

from mdrive_sumo.core.geometry import wrap_angles
from real2sim.clean import CleanedRecording, clean_recording
from real2sim.clean.cleaning_report import ChangeReason

pytestmark = pytest.mark.slow

REASONS = {
    "duplicate": {ChangeReason.DUPLICATE},
    "id flip": {ChangeReason.ID_FLIP},
    "jump": {ChangeReason.TELEPORT},
    "ego ghost": {ChangeReason.EGO_GHOST},
    "heading": {ChangeReason.HEADING},
    "gap": {ChangeReason.GAP},
}
"""How the report calls what was planted."""
ERROR_M = 0.6
"""Position error that counts as repaired: noise and bias of one observer, doubled."""
HEADING_RAD = 0.3
SHARE = 0.98


def repaired(fault: Fault, log: Log, cleaned: CleanedRecording) -> bool:
    """Whether exactly one track lies on the thing, near it and rightly turned in the frames of the fault."""
    thing, frames = log.truth[fault.thing], list(fault.frames)
    found = tracks_of(cleaned.tracks, thing)
    if len(found) != 1:
        return False
    track = found[0]
    error = np.hypot(track.x - thing.x, track.y - thing.y)
    turned = np.abs(wrap_angles(track.yaw - thing.yaw))
    if fault.kind == "id flip":
        frames = [frame for frame in track.valid_frames if abs(frame - frames[0]) < 40]
    near = bool(track.valid[frames].all() and (error[frames] < ERROR_M).all())
    return near and (fault.kind != "heading" or bool((turned[frames] < HEADING_RAD).all()))


def told(fault: Fault, log: Log, cleaned: CleanedRecording) -> bool:
    """Whether the report has an entry of that reason for the track, or for the name in the source that was left out.

    A duplicate too far off to be fused is left out for lying inside the track, which the entry names.
    """
    names = {track.id for track in tracks_of(cleaned.tracks, log.truth[fault.thing])} | {log.truth[fault.thing].id}
    inside = {
        change for change in cleaned.report.list_changes(ChangeReason.INSIDE) if names & set(change.detail.split())
    }
    found = {change for change in cleaned.report.changes if change.reason in REASONS[fault.kind]}
    return any(change.track in names for change in found) or bool(inside and fault.kind == "duplicate")


def rates(logs: Iterable[tuple[Log, list[Fault]]]) -> tuple[dict[str, float], list[Fault]]:
    """Share of repaired faults per kind, and those that no report mentions."""
    total, good, silent = Counter[str](), Counter[str](), list[Fault]()
    for log, faults in logs:
        cleaned = clean_recording(log.recording)
        for fault in faults:
            total[fault.kind] += 1
            good[fault.kind] += repaired(fault, log, cleaned)
            if not told(fault, log, cleaned):
                silent.append(fault)
    return {kind: good[kind] / total[kind] for kind in total}, silent


@pytest.mark.full  # all kinds at once: below
@pytest.mark.parametrize("kind", sorted(PLANTS))
def test_faults_of_one_kind_are_repaired_and_reported(kind: str) -> None:
    share, silent = rates([planted(observed(truth(seed), seed), seed, [kind]) for seed in range(4)])
    assert share[kind] >= SHARE
    assert silent == []


def test_all_kinds_at_once_are_repaired_and_reported() -> None:
    share, silent = rates([planted(observed(truth(seed), seed), seed) for seed in range(50, 52)])
    assert min(share.values()) >= SHARE, share
    assert silent == []


@pytest.mark.parametrize(
    "kind",
    ["id flip", *(pytest.param(kind, marks=pytest.mark.full) for kind in ("duplicate", "jump", "heading", "gap"))],
)
def test_one_observer_alone_is_repaired_too(kind: str) -> None:
    share, silent = rates([planted(alone(truth(seed), seed), seed, [kind]) for seed in range(80, 82)])
    assert share[kind] >= SHARE
    assert silent == []


@pytest.mark.full
def test_many_logs_with_all_faults() -> None:
    logs = [planted(observed(truth(seed), seed), seed) for seed in range(100, 160)]
    logs += [planted(alone(truth(seed), seed), seed, ["id flip", "jump", "heading", "gap"]) for seed in range(200, 230)]
    share, silent = rates(logs)
    assert min(share.values()) >= SHARE, share
    assert silent == []

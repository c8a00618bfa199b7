"""Findings of a small log made by hand, for tests of the report: what fails and what was changed is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import load_road_map
from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason, CleaningReport, TrackChange
from real2sim.conversion_findings import ConversionFindings
from real2sim.fit import Disposition, TrackRole
from real2sim.network import build_network
from real2sim.quality import ReconstructedLog, assess_reconstruction
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.traffic_fidelity import PositionErrors, TrafficFidelity
from testing.map_faults import lane, lanes_map

DT = 0.1
HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>&"
"""Breaks out of text and of attributes of both kinds if anything lets it."""


def track(
    id_: str, x: Float, y: Float, category: ObjectCategory = ObjectCategory.CAR, parked: bool = False
) -> RecordedTrack:
    n = len(x)
    size = (0.6, 0.6) if category is ObjectCategory.PEDESTRIAN else (4.5, 1.8)
    return RecordedTrack(
        id=id_,
        category=category,
        valid=np.ones(n, dtype=np.bool_),
        x=x,
        y=y,
        yaw=np.zeros(n),
        length=np.full(n, size[0]),
        width=np.full(n, size[1]),
        parked=parked,
    )


def log_of(tracks: tuple[RecordedTrack, ...], cavs: tuple[str, ...] = (), name: str = "log") -> Recording:
    """Tracks along a straight road of two lanes that runs along x."""
    road = lanes_map(
        lane("west", [(-50.0, 0.0), (150.0, 0.0)], ("east",), width=3.5, right_neighbour="slow"),
        lane("east", [(150.0, 0.0), (900.0, 0.0)], width=3.5),
        lane("slow", [(-50.0, -3.5), (150.0, -3.5)], width=3.5, left_neighbour="west"),
    )
    frames = len(tracks[0].valid)
    return Recording(
        name, "by hand", DT, frames, (ObserverView("log", tracks),), road, cavs, notes=(f"a note {HOSTILE}",)
    )


def findings_of(recording: Recording, folder: Path) -> ConversionFindings:
    """Everything the pipeline does before the fit."""
    cleaned = clean_recording(recording)
    vehicles = [one for one in cleaned.tracks if one.category.kind is Kind.VEHICLE]
    motions = [np.column_stack((one.x, one.y, one.yaw)) for one in vehicles]
    network = build_network(recording.map, motions, folder / "network", "by-hand", DT)
    tracks = reconstruct_tracks(cleaned.tracks, DT)
    raw = {one.id: one for one in cleaned.tracks}
    roads = load_road_map(folder / "network")
    lanes = LaneSegmentIndex.from_centre_lines([lane.centre.xy for lane in roads.driving], [True] * len(roads.driving))
    quality = assess_reconstruction(ReconstructedLog(recording.id, DT, tracks, raw, lanes))
    return ConversionFindings(recording.id, recording, cleaned, tracks, quality, network, roads)


def small_findings(folder: Path) -> ConversionFindings:
    """A CAV, a car that is too fast, one of a hostile name that passes, a walker, a parked car."""
    t = np.arange(60) * DT
    still = np.zeros(60)
    tracks = (
        track("cav", 10 * t, still),
        track("fast", 36 * t - 40, still - 3.5),
        track(HOSTILE, 8 * t + 30, still),
        track("walker", 20 + 1.2 * t, still + 4, ObjectCategory.PEDESTRIAN),
        track("parked", still + 60, still - 6, parked=True),
    )
    found = findings_of(log_of(tracks, ("cav",), f"log {HOSTILE}"), folder)
    changes = (
        *found.cleaned.report.changes,
        TrackChange(ChangeReason.TELEPORT, "fast", 3, f"2.10 m to the side {HOSTILE}"),
    )
    roles = {
        "cav": TrackRole(Disposition.CAV),
        "fast": TrackRole(Disposition.ACTOR, f"it leaves the road {HOSTILE}"),
        HOSTILE: TrackRole(Disposition.BACKGROUND),
        "walker": TrackRole(Disposition.ACTOR),
        "parked": TrackRole(Disposition.STANDING),
    }
    return replace(
        found,
        cleaned=replace(found.cleaned, report=CleaningReport(changes)),
        roles=roles,
        names={HOSTILE: "plain-name"},
        closeness=some_closeness(),
    )


def some_closeness() -> TrafficFidelity:
    errors = tuple(
        PositionErrors(after_s=s, vehicles=7, median=0.2 * s, lower=0.1 * s, upper=0.4 * s, worst=6.5)
        for s in (1.0, 3.0, 5.0)
    )
    unknown = PositionErrors(after_s=8.0, vehicles=0, median=None, lower=None, upper=None, worst=None)
    return TrafficFidelity(
        mode="reactive",
        vehicles=7,
        errors=(*errors, unknown),
        median_at_5s=1.0,
        order_pairs=20,
        order_kept=17,
        order_share=0.85,
        order_changed=(("plain-name", "cav"),),
        not_departed=(HOSTILE,),
        left_early=(),
        contacts=(),
    )

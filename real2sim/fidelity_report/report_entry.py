"""Entries of the report: the actors of a log, numbered, failing ones first, with tracks, verdict and disposition."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from real2sim.clean.cleaning_report import TrackChange
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import describe_failures, format_change
from real2sim.fit import Disposition, TrackRole
from real2sim.quality.actor_quality import ActorQuality
from real2sim.recording import ObjectCategory, RecordedTrack


@dataclass(frozen=True)
class ReportEntry:
    """One road user or object. Its number identifies it on the page, because ids of logs are long."""

    number: int
    actor: ActorQuality
    raw: RecordedTrack | None
    """Cleaned track of the log."""
    reconstructed: RecordedTrack | None
    role: TrackRole | None
    is_cav: bool
    changes: tuple[TrackChange, ...]
    """What cleaning changed of it."""

    @property
    def verdict_class(self) -> str:
        """CSS class of the verdict."""
        if self.actor.failed:
            return "fail"
        if not self.actor.moving:
            return "rest"
        return "walk" if self.actor.category in (ObjectCategory.PEDESTRIAN, ObjectCategory.BICYCLE) else "pass"

    @property
    def group(self) -> str:
        """Group of its card: "cav", or else the class of its verdict."""
        return "cav" if self.is_cav and not self.actor.failed else self.verdict_class

    @property
    def failures(self) -> list[str]:
        """A phrase for each failed check."""
        return describe_failures(self.actor)

    @property
    def change_phrases(self) -> list[str]:
        """A phrase for each change that cleaning made."""
        return [format_change(change) for change in self.changes]

    @property
    def best_track(self) -> RecordedTrack | None:
        """The reconstructed track, else the raw one."""
        return self.reconstructed or self.raw

    def format_time_span(self, dt_s: float) -> str:
        """Return when it is first and last seen, as the end of a phrase; "" if it never is."""
        track = self.best_track
        if track is None or not track.valid.any():
            return ""
        return f" from {track.valid_frames[0] * dt_s:.1f} s to {track.valid_frames[-1] * dt_s:.1f} s"

    @property
    def xy(self) -> Float:
        """Positions (N, 2) of both tracks where they are valid."""
        both = [track.xy[track.valid] for track in (self.raw, self.reconstructed) if track is not None]
        return np.concatenate(both) if both else np.zeros((0, 2))


def build_entries(findings: ConversionFindings) -> tuple[ReportEntry, ...]:
    """Return all entries: failing ones first, then moving ones, then CAVs and other vehicles before pedestrians."""
    raw = {track.id: track for track in findings.cleaned.tracks}
    tracks = {track.id: track for track in findings.tracks}
    changes: dict[str, list[TrackChange]] = {}
    for change in findings.cleaned.report.changes:
        changes.setdefault(change.track, []).append(change)
    cavs = set(findings.cleaned.cavs.values())
    cavs = {id_ for id_, role in findings.roles.items() if role.disposition is Disposition.CAV} or cavs

    def order(actor: ActorQuality) -> tuple[bool, bool, bool, bool, int]:
        scripted = ObjectCategory(actor.category).kind in (Kind.PEDESTRIAN, Kind.CYCLIST)
        return not actor.failed, not actor.moving, actor.id not in cavs, scripted, -len(actor.failed)

    return tuple(
        ReportEntry(
            number,
            actor,
            raw.get(actor.id),
            tracks.get(actor.id),
            findings.roles.get(actor.id),
            actor.id in cavs,
            tuple(changes.get(actor.id, ())),
        )
        for number, actor in enumerate(sorted(findings.quality.actors, key=order), 1)
    )

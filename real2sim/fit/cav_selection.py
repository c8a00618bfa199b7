"""Selection of the CAVs of a log by name, and sentences on those that the source names and the scenario lacks."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.errors import InputError
from real2sim.clean import CleanedRecording
from real2sim.fit.cavs import choose_cavs, explain_unusable, explain_unused_cavs
from real2sim.fit.traffic_fit import make_scenario_names
from real2sim.match import LaneMatch
from real2sim.recording import RecordedTrack


def select_cav_tracks(
    names: Sequence[str], cleaned: CleanedRecording, tracks: Sequence[RecordedTrack], matches: Mapping[str, LaneMatch]
) -> tuple[str, ...]:
    """Return the tracks of the named observers or tracks; without names those of the source, else the one that is
    present longest.

    A name is that of an observer, a track or a scenario actor, in this order, or a unique prefix.
    """
    if not names:
        return choose_cavs(tuple(cleaned.cavs.values()), tracks, matches)
    return tuple(dict.fromkeys(_find_track(name, cleaned, tracks, matches) for name in names))


def _find_track(
    name: str, cleaned: CleanedRecording, tracks: Sequence[RecordedTrack], matches: Mapping[str, LaneMatch]
) -> str:
    """Return the id of the track of that name; raises InputError that lists the usable vehicles."""
    shown = make_scenario_names(tracks)
    exact = [cleaned.cavs[name]] if name in cleaned.cavs else [name] if name in shown else []
    exact = exact or [id_ for id_, text in shown.items() if text == name]
    fitting = exact or [id_ for id_, text in shown.items() if id_.startswith(name) or text.startswith(name)]
    if len(fitting) == 1:
        return fitting[0]
    usable = sorted(
        shown[track.id] for track in tracks if not track.parked and not explain_unusable(track, matches.get(track.id))
    )
    what = f"{len(fitting)} whose names begin so" if fitting else "none of that name"
    raise InputError(
        f"CAV {name}: expected one of the vehicles {', '.join(usable) or '(none is usable)'}, found {what}"
    )


def describe_unused_cavs(
    names: Sequence[str],
    chosen: Sequence[str],
    cleaned: CleanedRecording,
    tracks: Sequence[RecordedTrack],
    matches: Mapping[str, LaneMatch],
) -> tuple[str, ...]:
    """Return a sentence for every CAV of the source that is not a CAV here, unless others were requested by name."""
    if names:
        return ()
    shown = make_scenario_names(tracks)
    others = ", ".join(shown[id_] for id_ in chosen)
    reasons = explain_unused_cavs(tuple(cleaned.cavs.values()), chosen, tracks, matches)
    return tuple(
        f"{id_}, a CAV of the source, is not a CAV here: {reason}; driven instead: {others}"
        for id_, reason in reasons.items()
    )

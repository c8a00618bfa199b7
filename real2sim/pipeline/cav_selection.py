"""Selection of the CAVs of a log, and checks and conversions between the steps of the pipeline."""

from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.scenario.scenario import RoadsideUnit
from real2sim.clean import CleanedRecording
from real2sim.fit import choose_cavs, explain_unusable, explain_unused_cavs, make_scenario_names
from real2sim.hd_map import HdMap, LaneKind
from real2sim.match import LaneMatch
from real2sim.recording import ObserverView, RecordedTrack, Recording

OFF_MAP_M = 30.0
"""[m] A vehicle further than this from every driving lane is off the map: wider than any car park beside a road."""
OFF_MAP_SHARE = 0.5
"""A map with a larger share of the vehicles' points off it belongs to another place (as in `readers.v2xpnp`)."""


def check_on_map(recording: Recording) -> None:
    """Raise InputError if most of the log lies off its map."""
    gaps = _distances_to_lanes(recording.map, _sample_vehicle_points(recording))
    if not len(gaps):
        return
    share = float((gaps > OFF_MAP_M).mean())
    if share > OFF_MAP_SHARE:
        raise InputError(
            f"expected tracks on the lanes of the map, found {share:.0%} of the vehicles' points more than"
            f" {OFF_MAP_M:g} m off (median {np.median(gaps):.0f} m): it is the map of another place"
        )


def _sample_vehicle_points(recording: Recording) -> Float:
    """Return positions of vehicles (N, 2) [m], at most ten per vehicle."""
    tracks = [track for view in recording.views for track in view.tracks if track.category.kind is Kind.VEHICLE]
    seen = [track.xy[track.valid_frames[:: max(len(track.valid_frames) // 10, 1)]] for track in tracks]
    return np.concatenate(seen) if seen else np.zeros((0, 2))


def _distances_to_lanes(map_: HdMap, xy: Float) -> Float:
    """Return distances (N,) [m] to the nearest driving lane; empty without a lane: `build_network` refuses such a
    map."""
    lanes = [lane for lane in map_.lanes.values() if lane.kind is LaneKind.DRIVING and len(lane.centre) > 1]
    if not lanes or not len(xy):
        return np.zeros(0)
    tree = shapely.STRtree([shapely.LineString(lane.centre) for lane in lanes])
    _, gaps = tree.query_nearest(shapely.points(xy), return_distance=True, all_matches=False)
    return gaps


def vehicle_trajectories(tracks: Sequence[RecordedTrack]) -> dict[str, Float]:
    """Return x, y, yaw (T, 3) of all vehicles by id."""
    vehicles = [track for track in tracks if track.category.kind is Kind.VEHICLE]
    return {track.id: np.column_stack((track.x, track.y, track.yaw)) for track in vehicles}


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
    found = exact or [id_ for id_, text in shown.items() if id_.startswith(name) or text.startswith(name)]
    if len(found) == 1:
        return found[0]
    usable = sorted(
        shown[one.id] for one in tracks if not one.parked and not explain_unusable(one, matches.get(one.id))
    )
    what = f"{len(found)} whose names begin so" if found else "none of that name"
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
    over = explain_unused_cavs(tuple(cleaned.cavs.values()), chosen, tracks, matches)
    return tuple(
        f"{id_}, a CAV of the source, is not a CAV here: {why}; driven instead: {others}" for id_, why in over.items()
    )


def build_roadside_units(views: Sequence[ObserverView]) -> tuple[RoadsideUnit, ...]:
    """Return the observers that are infrastructure, at the position of their sensor."""
    found: list[RoadsideUnit] = []
    for view in views:
        if view.is_infrastructure and np.isfinite(view.pose[:, :2]).all(1).any():
            x, y = np.nanmedian(view.pose[:, :2], axis=0).round(3).tolist()
            found.append(RoadsideUnit(id=f"rsu{view.observer.lstrip('-')}", x=x, y=y))
    return tuple(found)

"""Logs of all sources: found in folders, read, converted into a draft of a suite."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.errors import InputError
from mdrive_sumo.scenario.spec import save_scenario
from real2sim.build import Wish, build_log
from real2sim.quality_file import save_quality
from real2sim.readers.window import Window, windowed
from real2sim.recording import Recording
from real2sim.report_index import IndexLine, index_line
from real2sim.report_page import write_page
from real2sim.scene import Scene

BUCKETS = {"v2xpnp": "V2XPnP"}
CATEGORY = "real2sim"
LONGEST_S = 60.0
"""Longer logs need a window: an episode is a matter of seconds."""
PROPOSED_S = 20.0


@dataclass(frozen=True)
class Log:
    """One log: where it is, and how it is to be read."""

    source: str
    path: Path
    maps: tuple[Path, ...] = ()
    """Vector maps (v2xpnp), or the one Lanelet2 map (interaction; else the one beside the tracks)."""
    agents: tuple[str, ...] | None = None
    window: Window | None = None


@dataclass(frozen=True)
class Outcome:
    """A scenario of the draft, and what is told about it at the end."""

    id: str
    misses: tuple[str, ...]
    line: IndexLine | None
    """Of the index of pages, if there are any."""


def convert_log(log: Log, draft: Path, wish: Wish, page: bool) -> Outcome:
    """Writes DRAFT/<id>/ and DRAFT/networks/<id>/; raises InputError, one sentence that names the log."""
    try:
        recording = windowed(str(log.path), read(log), log.window)
        _check_length(recording)
        built = build_log(_scene(recording, log.window), draft, wish)
    except InputError as error:
        raise InputError(_naming(log, str(error))) from None
    folder = draft / built.scenario.id
    save_scenario(built.scenario, folder / "scenario.json")
    save_quality(built.quality, folder)
    if page:
        write_page(folder, built.findings)
    return Outcome(built.scenario.id, built.quality.misses, index_line(built.findings) if page else None)


def windows_of(log: Log, every_s: float) -> tuple[Window, ...]:
    """Windows of that length [s], one after another; a rest shorter than half of it belongs to none."""
    try:
        recording = windowed(str(log.path), read(log), log.window)
    except InputError as error:
        raise InputError(_naming(log, str(error))) from None
    first = log.window[0] if log.window else 0.0
    end = first + (recording.frames - 1) * recording.dt_s
    starts = [first + k * every_s for k in range(math.ceil((end - first) / every_s - 1e-6))]
    if len(starts) > 1 and end - starts[-1] < every_s / 2:
        starts.pop()
    return tuple((round(start, 3), round(min(start + every_s, end), 3)) for start in starts)


def read(log: Log) -> Recording:
    """Reads the whole log; raises InputError, also where a package of the extra `convert` is missing."""
    try:
        return READERS[log.source](log)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        raise InputError(
            f"{log.source}: expected the package {package}, found none (pip install 'mdrive-sumo[convert]')"
        ) from None


def _v2xpnp(log: Log) -> Recording:
    from real2sim.readers.v2xpnp import read_v2xpnp

    return read_v2xpnp(log.path, log.maps, log.agents)


def _scenarionet(log: Log) -> Recording:
    from real2sim.readers.scenarionet import read_scenarionet

    return read_scenarionet(log.path)


def _commonroad(log: Log) -> Recording:
    from real2sim.readers.commonroad import read_commonroad

    return read_commonroad(log.path)


def _argoverse2(log: Log) -> Recording:
    from real2sim.readers.argoverse2 import read_argoverse2

    return read_argoverse2(log.path)


def _interaction(log: Log) -> Recording:
    from real2sim.readers.interaction import read_interaction

    folder = log.path if log.path.is_dir() else log.path.parent
    maps = log.maps or tuple(sorted(folder.glob("*.osm")))
    if len(maps) != 1:
        raise InputError(f"{folder}: expected one Lanelet2 map *.osm beside the tracks (or --map), found {len(maps)}")
    return read_interaction(log.path, maps[0])


READERS: dict[str, Callable[[Log], Recording]] = {
    "v2xpnp": _v2xpnp,
    "scenarionet": _scenarionet,
    "commonroad": _commonroad,
    "argoverse2": _argoverse2,
    "interaction": _interaction,
}
"""Imported when they are used: each needs packages of the extra `convert`."""


def _check_length(recording: Recording) -> None:
    length_s = (recording.frames - 1) * recording.dt_s
    if length_s > LONGEST_S:
        raise InputError(
            f"expected at most {LONGEST_S:g} s, found a log of {length_s:g} s: choose a part with"
            f" --window 0,{PROPOSED_S:g}, or cut it into scenarios with --every {PROPOSED_S:g}"
        )


def _scene(recording: Recording, window: Window | None) -> Scene:
    part = f", {window[0]:g} s to {window[1]:g} s" if window else ""
    return Scene(
        id=scenario_id(recording.id, window),
        source=recording.source,
        bucket=BUCKETS.get(recording.source, "Real2Sim"),
        category=CATEGORY,
        map=recording.map,
        recording=recording,
        description=f"{recording.source} log {recording.id}{part}",
        notes=recording.notes,
    )


def scenario_id(log: str, window: Window | None) -> str:
    """The id of the log in the characters of an identifier, with its window."""
    part = f"_{window[0]:g}-{window[1]:g}s" if window else ""
    plain = re.sub(r"[^A-Za-z0-9_.+-]", "_", log).lstrip("_.+-") or "log"
    return plain[: 80 - len(part)] + part


def _naming(log: Log, sentence: str) -> str:
    named = sentence if str(log.path) in sentence else f"{log.path}: {sentence}"
    return f"{named} (window {log.window[0]:g} s to {log.window[1]:g} s)" if log.window else named

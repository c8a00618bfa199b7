"""Logs of all sources: their files and readers. A reader is imported when it is used."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.plug_ins import PlugInKind, check_plug_in_names, list_plug_ins

if TYPE_CHECKING:  # the command line asks for the sources only, and does not load numpy for that
    from real2sim.readers.time_grid import TimeWindow
    from real2sim.recording import Recording


@dataclass(frozen=True)
class LogSource:
    """One log: its file or folder and the options of its reader."""

    source: str
    path: Path
    maps: tuple[Path, ...] = ()
    """Maps of v2xpnp, v2xseq, opv2v (also OpenDRIVE), and the Lanelet2 map of interaction, levelx (else looked for)."""
    agents: tuple[str, ...] | None = None
    window: "TimeWindow | None" = None
    case: str = ""
    """One of several cases in the file (interaction 1.2)."""


def read_log(log: LogSource) -> "Recording":
    """Read the whole log; raises InputError, also if a package of the extra `convert` is missing."""
    try:
        recording = _find_reader(log.source)(log)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        raise InputError(
            f"{log.source}: expected the package {package}, found none ({format_installation('convert')})"
        ) from None
    from real2sim.readers.input_checks import check_extent

    check_extent(log.path, recording)
    return recording


def _v2xpnp(log: LogSource) -> "Recording":
    from real2sim.readers.v2xpnp import read_v2xpnp

    return read_v2xpnp(log.path, log.maps, log.agents)


def _scenarionet(log: LogSource) -> "Recording":
    from real2sim.readers.scenarionet import read_scenarionet

    return read_scenarionet(log.path)


def _commonroad(log: LogSource) -> "Recording":
    from real2sim.readers.commonroad import read_commonroad

    return read_commonroad(log.path)


def _argoverse2(log: LogSource) -> "Recording":
    from real2sim.readers.argoverse2 import read_argoverse2

    return read_argoverse2(log.path)


def _interaction(log: LogSource) -> "Recording":
    from real2sim.readers.interaction import find_interaction_map, read_interaction

    return read_interaction(log.path, find_interaction_map(log.path, log.maps), case=log.case)


def _levelx(log: LogSource) -> "Recording":
    from real2sim.readers.levelx import read_levelx

    return read_levelx(log.path, log.maps)


def _opv2v(log: LogSource) -> "Recording":
    """Read a log with a CARLA town as OpenDRIVE map, in whose network's frame the recording is, or a vector map."""
    from mdrive_sumo.roads import load_road_map
    from real2sim.carla.town_network import build_opendrive_network
    from real2sim.readers.opv2v import LogFrame, read_opv2v
    from real2sim.readers.v2xpnp_map import read_vector_map
    from real2sim.writers.episode_recording import build_hd_map

    if len(log.maps) != 1:
        raise InputError(f"{log.path}: expected one map (--map), an OpenDRIVE or a vector map, found {len(log.maps)}")
    if log.maps[0].suffix != ".xodr":
        hd_map, notes = read_vector_map(log.maps[0])
        recording = read_opv2v(log.path, hd_map, LogFrame(), log.agents)
        return replace(recording, notes=(*recording.notes, *notes))
    with tempfile.TemporaryDirectory() as folder:
        town = build_opendrive_network(log.maps[0], Path(folder))
        hd_map = build_hd_map(load_road_map(Path(folder)))
    return read_opv2v(log.path, hd_map, LogFrame(is_carla=True, offset=town.offset), log.agents)


def _v2xseq(log: LogSource) -> "Recording":
    from real2sim.readers.v2xseq import read_v2xseq

    return read_v2xseq(log.path, log.maps)


@dataclass(frozen=True, slots=True)
class ReaderPlugIn:
    """A reader of another package, for its entry point in the group `mdrive_sumo.readers`."""

    read: "Callable[[LogSource], Recording]"
    pattern: str
    """Glob of the names of its logs, such as `*.json`."""
    help: str = ""
    """One line for `convert --help`."""


def load_reader_plug_in(name: str) -> ReaderPlugIn | None:
    """Return a reader of another package; None if none has the name. Raises InputError for what is no reader."""
    check_plug_in_names(PlugInKind.READERS, READERS)
    plug_in = list_plug_ins(PlugInKind.READERS).get(name)
    if plug_in is None:
        return None
    reader = plug_in.load()
    if not isinstance(reader, ReaderPlugIn):
        raise InputError(f"{plug_in.describe()}: expected a ReaderPlugIn, found {reader!r:.80}")
    return reader


def _find_reader(source: str) -> "Callable[[LogSource], Recording]":
    plug_in = load_reader_plug_in(source)
    return READERS[source] if plug_in is None else plug_in.read


READERS: dict[str, "Callable[[LogSource], Recording]"] = {
    "v2xpnp": _v2xpnp,
    "scenarionet": _scenarionet,
    "commonroad": _commonroad,
    "argoverse2": _argoverse2,
    "interaction": _interaction,
    "levelx": _levelx,
    "opv2v": _opv2v,
    "v2xseq": _v2xseq,
}
"""By name of the source. Each reader needs packages of the extra `convert`, so it is imported on use."""


def prefix_with_log(log: LogSource, sentence: str) -> str:
    """Return a sentence with the path, the case and the window of the log."""
    text = sentence if str(log.path) in sentence else f"{log.path}: {sentence}"
    part = describe_part(log)
    return f"{text} ({part})" if part else text


def describe_part(log: LogSource) -> str:
    """Describe which part of its file the log is: case and window; "" for the whole file."""
    case = f"case {log.case}" if log.case else ""
    window = f"window {log.window[0]:g} s to {log.window[1]:g} s" if log.window else ""
    return ", ".join(filter(None, (case, window)))

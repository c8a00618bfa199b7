"""Which settings of two runs differ, by their results and, where there is one, by their journals."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_fingerprint
from mdrive_sumo.scoring import RunInfo

ABSENT = "-"
"""A setting that a run does not have."""
MAX_TEXT = 40
"""Characters of a value in the table of `compare`: two of them and a name fit into the 100 columns of a terminal."""


@dataclass(frozen=True, slots=True)
class SettingDifference:
    """A setting that two runs do not share, with both values as text."""

    name: str
    a: str
    b: str

    def __str__(self) -> str:
        return f"{self.name}: {self.a} and {self.b}"


def find_setting_differences(
    a: RunInfo, b: RunInfo, folders: tuple[Path | None, Path | None] = (None, None)
) -> tuple[SettingDifference, ...]:
    """Return the settings in which two runs differ, besides suite, seeds and versions.

    folders: their run folders, whose journals also name the options and the code of the agents.
    """
    return compare_settings(*(list_settings(info, folder) for info, folder in zip((a, b), folders, strict=True)))


def compare_settings(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[SettingDifference, ...]:
    """Return the differences of two runs' settings, as `list_settings` returns them."""
    names = dict.fromkeys((*first, *second))
    return tuple(
        SettingDifference(name, format_setting(first.get(name)), format_setting(second.get(name)))
        for name in names
        if first.get(name) != second.get(name)
        and not (name in _NOT_ALWAYS_KNOWN and (name in first) != (name in second))
    )


LIBRARY_CODE = "library code"
"""Name of the checksum of the library's own code, as reports list it among the settings."""
SENSING_TRACK = "sensing track"
_NOT_ALWAYS_KNOWN = ("agent code", "sandbox", LIBRARY_CODE, SENSING_TRACK)
"""Settings that only a journal or newer results have: unknown is no difference."""


def list_settings(info: RunInfo, folder: Path | None = None) -> dict[str, Any]:
    """Return the settings of a run by name. folder: its run folder, whose journal names more of them."""
    fingerprint = _read_fingerprint(folder)
    settings: dict[str, Any] = {"agent": info.agent}
    settings |= dict(_list_agent_settings(info, fingerprint))
    if info.others:
        settings |= {"others": info.others, "penetration": "one CAV" if info.penetration is None else info.penetration}
    settings |= {f"comm {name}": value for name, value in info.comm.items() if name != "preset"}
    settings["agent clock"] = info.agent_clock
    if info.sensing_track:
        settings[SENSING_TRACK] = info.sensing_track
    settings |= info.conditions
    if limits := fingerprint.get("agent_limits"):
        settings["agent limits"] = limits
    settings |= {f"plug-in {name}": identity for name, identity in info.plug_ins.items()}
    if fingerprint:
        settings["sandbox"] = bool(fingerprint.get("sandbox", False))
    return settings


def _list_agent_settings(info: RunInfo, fingerprint: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    if code := fingerprint.get("agent_code"):
        yield "agent code", code
    if files := fingerprint.get("agent_files"):
        yield "agent files", files
    try:
        options = json.loads(fingerprint.get("agent_config", ""))
    except (ValueError, TypeError, RecursionError):
        yield "agent config", info.agent_config
        return
    if isinstance(options, dict):
        yield from ((f"agent config {name}", value) for name, value in sorted(options.items()))


def _read_fingerprint(folder: Path | None) -> Mapping[str, Any]:
    """Return the fingerprint of a run folder; an empty one if it has no readable journal."""
    if folder is None or not (folder / JOURNAL_FILE).is_file():
        return {}
    try:
        return read_fingerprint(folder)
    except InputError:
        return {}


def format_setting(value: object) -> str:
    """Return the value of a setting as short text."""
    if value is None:
        return ABSENT
    text = f"{value:g}" if isinstance(value, float) else str(value)
    text = text.removeprefix("sha256:")[:12] if text.startswith("sha256:") else text
    return truncate(text, MAX_TEXT)

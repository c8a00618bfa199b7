"""Paths in the fingerprint of a run, relative to its folder: agents, a suite of one's own, files that options name."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.json_object import parse_json_object
from mdrive_sumo.core.private_paths import hide_locator, relate_path, restore_locator, restore_path

AGENT_KEYS = ("agent", "others")
OPTIONS_KEY = "agent_config"
SUITE_KEY = "suite"
"""The settings of `RunConfig` whose values are or hold paths."""
MARK = "run:"
"""Before the path of a file that an option names."""


def hide_paths(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a fingerprint without absolute paths. folder: of the run."""
    hidden = dict(values)
    for key in AGENT_KEYS:
        if key in hidden:
            hidden[key] = hide_locator(hidden[key], folder)
    if Path(hidden[SUITE_KEY]).is_absolute():
        hidden[SUITE_KEY] = relate_path(Path(hidden[SUITE_KEY]), folder)
    options = json.loads(hidden[OPTIONS_KEY])
    if any(map(_is_file, options.values())):
        changed = {name: _hide_option(value, folder) for name, value in options.items()}
        hidden[OPTIONS_KEY] = json.dumps(changed, sort_keys=True, separators=(",", ":"))
    return hidden


def restore_paths(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a fingerprint of a journal with the paths as they are on this machine; values of other types stay."""
    restored = dict(values)
    for key in AGENT_KEYS:
        if isinstance(name := restored.get(key), str):
            restored[key] = restore_locator(name, folder)
    if isinstance(suite := restored.get(SUITE_KEY), str) and suite.startswith("."):
        restored[SUITE_KEY] = str(restore_path(suite, folder))
    text = restored.get(OPTIONS_KEY)
    if isinstance(text, str) and f'"{MARK}' in text:
        options = parse_json_object(text, OPTIONS_KEY)
        changed = {name: _restore_option(value, folder) for name, value in options.items()}
        restored[OPTIONS_KEY] = json.dumps(changed, sort_keys=True, separators=(",", ":"))
    return restored


def _is_file(value: object) -> bool:
    try:
        return isinstance(value, str) and Path(value).is_absolute() and Path(value).exists()
    except OSError:  # a path that the system cannot have
        return False


def _hide_option(value: object, folder: Path) -> object:
    return f"{MARK}{relate_path(Path(value), folder)}" if isinstance(value, str) and _is_file(value) else value


def _restore_option(value: object, folder: Path) -> object:
    is_marked = isinstance(value, str) and value.startswith(MARK)
    return str(restore_path(str(value).removeprefix(MARK), folder)) if is_marked else value

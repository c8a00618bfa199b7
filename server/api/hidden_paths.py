"""Removes paths of this machine from sentences that leave it: they name users, folders and hidden suites."""

import re
from pathlib import Path

HIDDEN_PATH = "(a path of the server)"
_PATH = re.compile(r"(?<![\w./:-])/[\w.@+-]+(?:/[\w.@+-]+)+/?")
_NO_SERVER_PATHS = ("/api/", "/agent/")
"""Beginnings of addresses, and of paths inside a box."""


def hide_paths(sentence: str) -> str:
    """Return a sentence without absolute paths whose first folder exists on this machine."""
    return _PATH.sub(lambda found: HIDDEN_PATH if _is_server_path(found[0]) else found[0], sentence)


def _is_server_path(path: str) -> bool:
    return not path.startswith(_NO_SERVER_PATHS) and Path(*Path(path).parts[:2]).is_dir()

"""The files of the drive page, read as the server reads them. No tests in here."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files

PAGE = "drive.html"
SHARED = ("three.min.js", "view_3d")
"""Beginnings of the names of the scripts that replays have as well."""


@cache
def read_page_files() -> Mapping[str, bytes]:
    """Return the content of each file by its name."""
    own = {file.name: file.read_bytes() for file in files("server.drive").joinpath("static").iterdir()}
    replay = files("mdrive_sumo.report").joinpath("static").iterdir()
    return own | {file.name: file.read_bytes() for file in replay if file.name.startswith(SHARED)}

"""The files of the drive page, by the names under which the page asks for them."""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from mdrive_sumo.report.palette import CAV_COLOURS, format_custom_properties

PAGE = "drive.html"
_SHARED = ("three.min.js", "view_3d")
"""Beginnings of the names of the scripts of replays that the page uses as well."""


@cache
def read_page_files() -> Mapping[str, bytes]:
    """Return the content of each file: `PAGE`, style sheets and scripts, those that replays share, and the colours."""
    own = {file.name: file.read_bytes() for file in files("server.drive").joinpath("static").iterdir()}
    replay = files("mdrive_sumo.report").joinpath("static").iterdir()
    shared = {file.name: file.read_bytes() for file in replay if file.name.startswith(_SHARED)}
    colours = {
        "palette.css": format_custom_properties().encode(),
        "palette.js": f"const CAV_COLOURS = {json.dumps(CAV_COLOURS)};\n".encode(),
    }
    return {**own, **shared, **colours}

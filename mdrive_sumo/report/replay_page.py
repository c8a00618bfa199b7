"""The replay of an episode: one self-contained HTML page that never accesses the network."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Self

from jinja2 import Environment, StrictUndefined

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.camera_archive import CameraTrack
from mdrive_sumo.report.palette import CAV_COLOURS, format_custom_properties
from mdrive_sumo.report.replay_cameras import pack_camera_images
from mdrive_sumo.report.replay_data import pack_replay_data
from mdrive_sumo.report.replay_marks import ReplayMark, find_marks
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult

SCRIPTS = (
    "viewer_replay.js",
    "viewer_talk.js",
    "viewer_map.js",
    "viewer_labels.js",
    "viewer_scene.js",
    "viewer_layers.js",
    "viewer_timeline.js",
    "viewer_panel.js",
    "viewer_lists.js",
    "viewer_room.js",
    "viewer_cameras.js",
    "viewer_input.js",
    "viewer_beside.js",
    "viewer.js",
)
FRAME_HEIGHT_PX = 640
"""Height of the page inside a notebook."""


@dataclass(frozen=True, slots=True)
class ReplayPage:
    """A replay page as a value: a notebook shows it inline, `save` writes it to a file."""

    html: str

    @classmethod
    def build(cls, record: EpisodeRecord, scenario: Scenario, roads: RoadMap, result: ScenarioResult) -> Self:
        """Build the page of a scored episode, with marks for its infractions and arrivals."""
        return cls(render_replay(record, scenario, roads, find_marks(record, result), result))

    def save(self, path: str | Path) -> Path:
        """Write the page, for any browser, and return its path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.html, encoding="utf-8")
        return path

    def __repr__(self) -> str:
        return f"ReplayPage({len(self.html)} characters; .save(path) writes it)"

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, so that neither its style nor its script reach the notebook."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="100%" height="{FRAME_HEIGHT_PX}"'
            ' style="border: 0" sandbox="allow-scripts"></iframe>'
        )


def render_replay(
    episode: EpisodeRecord,
    scenario: Scenario,
    roads: RoadMap,
    marks: Sequence[ReplayMark],
    result: ScenarioResult | None = None,
    cameras: Sequence[CameraTrack] = (),
) -> str:
    """Return the page, with the scores of `result` and the images of cameras.

    The same episode gives the same bytes; its content policy forbids every connection.
    """
    style, script = build_replay_style(), build_replay_script()
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    return environment.from_string(_read_static("viewer.html")).render(
        title=f"{scenario.id} · mdrive-sumo",
        style=style,
        style_hash=hash_for_policy(style),
        script=script,
        script_hash=hash_for_policy(script),
        data=pack_replay_data(episode, scenario, roads, marks, result),
        camera_images=pack_camera_images(episode, cameras),
    )


def build_replay_style() -> str:
    """Return the style sheet of every replay page."""
    return format_custom_properties() + _read_static("viewer.css")


def build_replay_script() -> str:
    """Return the script of every replay page."""
    return "\n".join((f"const CAV_COLOURS = {json.dumps(CAV_COLOURS)};", *map(_read_static, SCRIPTS)))


def _read_static(name: str) -> str:
    return (files("mdrive_sumo.report") / "static" / name).read_text("utf-8")


def hash_for_policy(text: str) -> str:
    """Return the name of an inline script or style in a Content-Security-Policy (CSP level 3, section 2.3.1)."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()

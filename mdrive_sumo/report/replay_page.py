"""The replay of an episode: one self-contained HTML page that never accesses the network."""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.camera_archive import CameraTrack
from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import CAV_COLOURS, format_custom_properties
from mdrive_sumo.report.replay_data import find_origin, pack_camera_images, pack_replay_data
from mdrive_sumo.report.replay_marks import ReplayMark, find_marks
from mdrive_sumo.report.replay_scene import pack_replay_scene, pack_view_3d_script
from mdrive_sumo.report.view_3d_script import build_view_3d_script
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
    "viewer_3d.js",
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
        make_parents(path)
        write_text(path, self.html)
        return path

    def __repr__(self) -> str:
        return f"ReplayPage({len(self.html) / 1e6:.1f} MB of HTML; .save(path) writes it)"

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
    page = render_html_page(
        "viewer.html",
        title=f"{scenario.id} · mdrive-sumo",
        style=build_replay_style(),
        script=build_replay_script(),
        data=pack_replay_data(episode, scenario, roads, marks, result),
        camera_images=pack_camera_images(episode, cameras),
        scene=pack_replay_scene(episode, scenario, roads, find_origin(scenario)),
        view_3d=pack_view_3d_script(),
        late_scripts=(build_view_3d_script(),),
    )
    return page + "\n"


def build_replay_style() -> str:
    """Return the style sheet of every replay page."""
    return format_custom_properties() + read_static("viewer.css")


def build_replay_script() -> str:
    """Return the script of every replay page."""
    return "\n".join((f"const CAV_COLOURS = {json.dumps(CAV_COLOURS)};", *map(read_static, SCRIPTS)))

"""Two replays of one scenario in step: one page with both, one time line, and the tick in which they part."""

from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.core.state import DT
from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.report.replay_page import build_replay_script, build_replay_style
from mdrive_sumo.report.view_3d_script import build_view_3d_script
from mdrive_sumo.runs.episode_difference import EpisodeDifference

APART_M = 1.0
"""Replays are apart from where a CAV is farther than this [m] from its place in the other: what an eye can see."""


@dataclass(frozen=True, slots=True)
class InStepSide:
    """One of the two replays."""

    letter: str
    agent: str
    name: str
    """Name of the run's folder."""
    ds: float
    html: str
    """The replay page as HTML."""


def render_in_step(
    scenario: str,
    seed_text: str,
    sides: Sequence[InStepSide],
    parting: EpisodeDifference | None,
    separation: EpisodeDifference | None,
) -> str:
    """Return the page. Its content policy forbids every connection and every script but its own and the replays'.

    parting: the first tick in which the CAVs differ; None if they never do. separation: the first in which a CAV is
    farther than `APART_M` from its place in the other.
    """
    return render_html_page(
        "in_step.html",
        title=f"{scenario}: {' and '.join(side.agent for side in sides)} in step · mdrive-sumo",
        scenario=scenario,
        seed_text=seed_text,
        sides=sides,
        parting=parting,
        separation=separation,
        apart_m=APART_M,
        tick_s=DT,
        style=format_custom_properties() + read_static("in_step.css"),
        script=read_static("in_step.js"),
        frame_styles=(build_replay_style(),),
        frame_scripts=(build_replay_script(), build_view_3d_script()),
    )

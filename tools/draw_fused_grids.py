"""Draw what other cars add: own grid, features received, fused detections and truth of some frames, side by side.

    python -m tools.draw_fused_grids DATA PICTURE.png [--detector attfuse] [--weights DIR] [--frame N]...

DATA is a folder of `learn scans`. Without --frame it takes three frames, of different places where there are as many,
those with the most vehicles that the own scan has no point on and a sender's has: chosen by what there is, not by what
a detector finds.
Features pass through the codec of messages with the budget of a drive, and lie where the estimated poses put them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from mdrive_sumo.agents.learned.box_decoding import MAX_IOU, DetectedBoxes
from mdrive_sumo.agents.learned.detector_agent import OPTIONS, stack_maps
from mdrive_sumo.agents.learned.feature_inbox import ReceivedMap
from mdrive_sumo.agents.learned.fusion_network import FusionDetector, load_detector
from mdrive_sumo.agents.learned.fusion_spec import (
    FEATURE_CELL_M,
    FEATURE_CELLS,
    FUSIONS,
    GRID_CELLS,
    GRID_REACH_M,
    LEAST_CONFIDENCE,
)
from mdrive_sumo.agents.learned.point_grid import Cells, expand_cells
from mdrive_sumo.agents.learned.shared_grids import build_feature_grid, encode_features
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.fusion.frame_files import read_frames
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.perception.box_iou import compute_ious
from mdrive_sumo.report.figure_style import COLOURS, open_figure, render_figure
from mdrive_sumo.v2x.feature_map import assemble_feature_map
from mdrive_sumo.v2x.messages import Feature, ReferencePose, decode
from tools.tool_command import HELP, ToolCommand, write_small_picture

SCENES = 3
"""Rows of a picture that fits a page; chosen."""
MIN_IOU = 0.5
"""From here on a detection is the true box, or what the own scan finds alone."""
CAR_M = 4.9, 2.1
"""Length and width of a CAV."""
TITLES = ("own grid", "features received", "detections", "truth")
OWN, OTHERS, UNSEEN, NOT_ARRIVED = COLOURS[0], COLOURS[1], "#888888", "#cfcfcf"
PANEL_IN, LEGEND_IN = 2.75, 0.9
ARROW_M = np.array(((3.0, 0.0), (-2.2, 1.7), (-1.2, 0.0), (-2.2, -1.7)))
"""A car of those that share, as an arrow head."""


@dataclass(frozen=True, slots=True)
class FusedScene:
    """A frame as its own car sees it. Everything is in the frame of that car: x ahead, y left [m]."""

    title: str
    counts: npt.NDArray[np.float32]
    """(GRID_CELLS / 2, GRID_CELLS / 2) what the own scan has above the ground."""
    received: npt.NDArray[np.float32]
    """(FEATURE_CELLS, FEATURE_CELLS) sum of the features of others, of several senders the largest; NaN: none came."""
    cars: Float
    """(N, 3) x, y, yaw of the own car and of the senders, where messages say they are."""
    found: DetectedBoxes
    is_new: Bool
    """Of each box found: whether the own scan alone does not find it."""
    is_right: Bool
    """Whether it lies on a true box."""
    boxes: Float
    """(M, 5) true boxes."""
    is_seen: Bool
    """(M, cars) whether a car has a point on it."""

    def describe(self) -> str:
        """Return in a sentence what others added."""
        hidden = int((self.is_seen.any(axis=1) & ~self.is_seen[:, 0]).sum())
        right, new = int(self.is_right.sum()), int((self.is_right & self.is_new).sum())
        wrong = len(self.is_right) - right
        return (
            f"{self.title}: {len(self.boxes)} road users, {hidden} of them seen by others only; found {right}, {new} of"
            f" them not by the own scan alone; {wrong} detections lie on no true box"
        )


def choose_frames(frames: FusionFrames, count: int) -> list[int]:
    """Return the frames with the most vehicles that only senders have points on, one of each place.

    If there are fewer places than wanted, other drives at them follow. Raises InputError without such frames.
    """
    is_hidden = frames.is_target & (frames.box_class == 0) & (frames.box_points[:, :, 0] == 0)
    hidden = is_hidden.sum(axis=1)
    order = [row for row in np.argsort(-hidden, kind="stable").tolist() if hidden[row]]
    if not order:
        raise InputError("frames: expected some with vehicles that only senders see, found none")
    by_place = {int(frames.place[row]): row for row in reversed(order)}
    by_drive = {(int(frames.place[row]), int(frames.episode[row])): row for row in reversed(order)}
    chosen = sorted(by_place.values(), key=order.index)
    chosen += [row for row in sorted(by_drive.values(), key=order.index) if row not in chosen]
    return chosen[:count]


def build_scene(frames: FusionFrames, row: int, detector: FusionDetector) -> FusedScene:
    """Return what a car receives and finds in a frame."""
    senders = [car for car in range(1, frames.scan.shape[1]) if frames.scan[row, car, 0] >= 0]
    cells = frames.get_scan(int(frames.scan[row, 0, 0]))
    own = detector.encode(cells)
    maps = [one for car in senders if (one := _receive(frames, row, car, detector)) is not None]
    found = _keep_certain(detector.detect(*stack_maps(own, maps)))
    alone = _keep_certain(detector.detect(*stack_maps(own, [])))
    is_used = frames.box_class[row] >= 0
    boxes = frames.boxes[row][is_used].astype(np.float64)
    poses = frames.estimated_pose[row, senders, 0].astype(np.float64)
    return FusedScene(
        f"{frames.places[frames.place[row]]}, tick {int(frames.tick[row])}",
        _count_points(cells),
        _place_features(maps),
        np.concatenate((np.zeros((1, 3)), poses)),
        found,
        ~_is_matched(found.boxes, alone.boxes),
        _is_matched(found.boxes, boxes),
        boxes,
        frames.box_points[row][is_used][:, [0, *senders]] > 0,
    )


def _count_points(cells: Cells) -> npt.NDArray[np.float32]:
    """Return the logarithms of counts above the ground, of 2 x 2 cells the largest, which are easier to see."""
    sums = expand_cells(cells)[1:].sum(axis=0)
    return sums.reshape(GRID_CELLS // 2, 2, GRID_CELLS // 2, 2).max(axis=(1, 3))


def _receive(frames: FusionFrames, row: int, car: int, detector: FusionDetector) -> ReceivedMap | None:
    """Return what arrives of a sender's scan when nothing is lost; None if it has nothing to say."""
    scan = detector.encode(frames.get_scan(int(frames.scan[row, car, 0])))
    grid = build_feature_grid(detector)
    messages = encode_features(scan, ReferencePose(0.0, 0.0, 0.0, 0), grid, OPTIONS["budget"].default, LEAST_CONFIDENCE)
    packets = [one for message in messages if isinstance(one := decode(message), Feature)]
    if not packets:
        return None
    return ReceivedMap(str(car), assemble_feature_map(packets, grid), frames.estimated_pose[row, car, 0], 0.0)


def _keep_certain(found: DetectedBoxes) -> DetectedBoxes:
    """Return the boxes that an agent would believe: certain ones that are not the own car, which others see."""
    overlaps = compute_ious(found.boxes, np.array(((0.0, 0.0, 0.0, *CAR_M),)))[:, 0]
    kept = (found.scores >= OPTIONS["score"].default) & (overlaps <= MAX_IOU)
    return DetectedBoxes(found.boxes[kept], found.classes[kept], found.scores[kept])


def _is_matched(boxes: Float, others: Float) -> Bool:
    """Return for each box whether it lies on one of the others."""
    return np.asarray((compute_ious(boxes, others) >= MIN_IOU).any(axis=1))


def _place_features(maps: Sequence[ReceivedMap]) -> npt.NDArray[np.float32]:
    """Return the features of others in the cells of the own grid, each from the sender's cell that holds its centre."""
    offsets = GRID_REACH_M - (np.arange(FEATURE_CELLS) + 0.5) * FEATURE_CELL_M
    x, y = np.meshgrid(offsets, offsets, indexing="ij")  # row 0 is ahead, column 0 left
    whole = np.full((FEATURE_CELLS, FEATURE_CELLS), np.nan, np.float32)
    for one in maps:
        dx, dy = x - float(one.pose[0]), y - float(one.pose[1])
        cos, sin = np.cos(float(one.pose[2])), np.sin(float(one.pose[2]))
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        row, column = (np.floor((GRID_REACH_M - way) / FEATURE_CELL_M).astype(int) for way in (ahead, left))
        inside = (row >= 0) & (row < FEATURE_CELLS) & (column >= 0) & (column < FEATURE_CELLS)
        sums = np.where(one.map.arrived, one.map.features.sum(axis=0), np.float32(np.nan))
        whole[inside] = np.fmax(whole[inside], sums[row[inside], column[inside]])
    return whole


def draw_scenes(scenes: Sequence[FusedScene], path: Path) -> None:
    """Write a picture with a row for each scene."""
    width, height = len(TITLES) * PANEL_IN, len(scenes) * PANEL_IN + LEGEND_IN
    with open_figure(width, height) as figure:
        axes = figure.subplots(len(scenes), len(TITLES), squeeze=False)
        for scene, row in zip(scenes, axes, strict=True):
            _draw_row(scene, row)
        for title, one in zip(TITLES, axes[0], strict=True):
            one.set_title(title, fontsize=10)
        handles = [
            Line2D([], [], color=OWN, label="found by the own scan alone; seen by the own car"),
            Line2D([], [], color=OTHERS, label="found only with what others sent; seen by others only"),
            Line2D([], [], color=UNSEEN, label="true box that no car has a point on"),
            Line2D([], [], color="black", linestyle=":", label=f"detection that lies on no true box (IoU {MIN_IOU})"),
            Line2D([], [], color=NOT_ARRIVED, lw=6, label="no features arrived; among detections: a true box"),
            Line2D([], [], color="black", marker="^", linestyle="", label="own car"),
            Line2D([], [], color=COLOURS[2], marker="^", linestyle="", label="sender"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
        content = render_figure(figure, "png")
    write_small_picture(content, path)


def _draw_row(scene: FusedScene, panels: Sequence[Axes]) -> None:
    grid, received, detections, truth = panels
    reach = -GRID_REACH_M, GRID_REACH_M, -GRID_REACH_M, GRID_REACH_M
    for one in panels:
        one.set(xlim=reach[:2], ylim=reach[:2], xticks=(), yticks=(), aspect="equal")
        one.grid(visible=False)
        one.spines[:].set_visible(True)
        for i, car in enumerate(scene.cars):
            _draw_car(one, car, COLOURS[2] if i else "black")
    grid.set_ylabel(scene.title, fontsize=8)
    grid.imshow(scene.counts, cmap="Greys", extent=reach, vmin=0.0, interpolation="nearest")
    received.set_facecolor(NOT_ARRIVED)
    received.imshow(scene.received, cmap="Purples", extent=reach, vmin=0.0, interpolation="nearest")
    for box in scene.boxes:
        detections.add_patch(Polygon(_find_corners(box), facecolor="#dddddd", edgecolor="none", zorder=0))
    for box, is_new, is_right in zip(scene.found.boxes, scene.is_new, scene.is_right, strict=True):
        _draw_box(detections, box, OTHERS if is_new else OWN, is_right=is_right)
    for box, is_seen in zip(scene.boxes, scene.is_seen, strict=True):
        _draw_box(truth, box, OWN if is_seen[0] else OTHERS if is_seen.any() else UNSEEN)


def _turn(xy: Float) -> Float:
    """Return points (N, 2) of the car's frame as they are drawn: ahead is up."""
    return np.column_stack((-xy[:, 1], xy[:, 0]))


def _draw_car(axes: Axes, pose: Float, colour: str) -> None:
    x, y, yaw = pose.tolist()
    turned = np.array(((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))))
    axes.add_patch(Polygon(_turn(ARROW_M @ turned + (x, y)), facecolor=colour, edgecolor="white", lw=0.5, zorder=3))


def _draw_box(axes: Axes, box: Float, colour: str, *, is_right: bool = True) -> None:
    style = "-" if is_right else ":"
    axes.add_patch(Polygon(_find_corners(box), fill=False, edgecolor=colour, lw=1.4, linestyle=style))


def _find_corners(box: Float) -> Float:
    return _turn(boxes_corners(*box[:, None])[0])


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("data", type=click.Path(path_type=Path, file_okay=False))
@click.argument("picture", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--detector", type=click.Choice(FUSIONS), default="attfuse", show_default=True)
@click.option("--weights", type=click.Path(path_type=Path), metavar="DIR", help="Folder of weights, else the packaged.")
@click.option("--frame", "rows", multiple=True, type=click.IntRange(0), help="Number of a frame; may repeat.")
def main(data: Path, picture: Path, detector: str, weights: Path | None, rows: tuple[int, ...]) -> None:
    """Draw frames of DATA into PICTURE, and say of each what others added."""
    frames = read_frames(data)
    if (most := max(rows, default=0)) >= len(frames):
        raise InputError(f"--frame: expected a number below {len(frames)}, found {most}")
    network = load_detector(detector, weights)
    scenes = [build_scene(frames, row, network) for row in rows or choose_frames(frames, SCENES)]
    draw_scenes(scenes, picture)
    for scene in scenes:
        echo(scene.describe())


if __name__ == "__main__":
    main()

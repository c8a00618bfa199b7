"""Canvas: a picture in memory that areas, lines and texts are painted on, with the rasteriser of matplotlib (Agg)."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_hex, to_rgba
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.render.cameras import Rings

Pixels = npt.NDArray[np.uint8]
Align = Literal["left", "centre", "right"]
GAP_PX = 4
"""[px] Between pictures side by side."""
POINTS_PER_INCH = 72
"""With as many pixels an inch, a point is a pixel."""


class Canvas:
    """A picture. Pixels: x to the right, y down; colours: names or hexadecimal, also with an opacity as #rrggbbaa."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._agg: Any = RendererAgg(width, height, POINTS_PER_INCH)
        self._flip = Affine2D().scale(1, -1).translate(0, height)

    def fill(self, rings: Rings, colour: str, edge: str = "", edge_px: float = 1.0) -> None:
        """Fill areas (non-zero winding rule), with an edge if it has a colour."""
        if len(rings.points):
            self._draw(_build_closed_path(rings), colour, edge, edge_px)

    def fill_outline(self, outline: Float, colour: str, edge: str = "", edge_px: float = 1.0) -> None:
        """Fill one area (K, 2)."""
        self._draw(Path(np.concatenate((outline, outline[:1])), closed=True), colour, edge, edge_px)

    def fill_card(self, box: tuple[float, float, float, float], colour: str, edge: str = "") -> None:
        """Fill a rectangle (left, top, right, bottom)."""
        left, top, right, bottom = box
        self.fill_outline(np.array(((left, top), (right, top), (right, bottom), (left, bottom))), colour, edge)

    def fill_disc(self, x: float, y: float, radius: float, colour: str, edge: str = "", edge_px: float = 1.0) -> None:
        """Fill a disc."""
        transform = Affine2D().scale(radius).translate(x, y)
        self._draw(Path.unit_circle().transformed(transform), colour, edge, edge_px)

    def draw_line(self, points: Float, colour: str, width_px: float) -> None:
        """Draw a line through points (K, 2) with round ends."""
        self._draw(Path(points), "", colour, width_px)

    def write(self, text: str, place: tuple[float, float], size_px: float, colour: str, align: Align = "left") -> None:
        """Write a bold line of text; `place` is the left end, middle or right end of its base line."""
        outline, width = _lay_out_text(text, size_px)
        if not width:
            return
        shift = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width
        transform = Affine2D().scale(1, -1).translate(place[0] - shift, place[1])
        self._draw(outline.transformed(transform), colour, "", 0.0)

    def measure(self, text: str, size_px: float) -> float:
        """Return the width [px] of a text."""
        return _lay_out_text(text, size_px)[1]

    def copy_background(self) -> object:
        """Return what is painted so far, for `restore_background`."""
        return self._agg.copy_from_bbox(self._agg.bbox)

    def restore_background(self, background: object) -> None:
        """Replace everything by an earlier picture."""
        self._agg.restore_region(background)

    def paint_picture(self, picture: Pixels) -> None:
        """Replace everything by a picture (height, width, 3)."""
        pixels = np.asarray(self._agg.buffer_rgba())
        pixels[..., :3], pixels[..., 3] = picture, 255

    def to_array(self) -> Pixels:
        """Return a copy (height, width, 3) of the picture."""
        return np.asarray(self._agg.buffer_rgba())[..., :3].copy()

    def _draw(self, path: Path, face: str, edge: str, edge_px: float) -> None:
        pen = self._agg.new_gc()
        pen.set_linewidth(edge_px if edge else 0.0)
        pen.set_foreground(_parse_colour(edge or face), isRGBA=True)
        pen.set_joinstyle("round")
        pen.set_capstyle("round")
        pen.set_snap(False)
        self._agg.draw_path(pen, path, self._flip, _parse_colour(face) if face else None)


def join_pictures(pictures: Sequence[Pixels], width: int) -> Pixels:
    """Return pictures of one size side by side on a white picture of a width [px], with gaps of `GAP_PX`."""
    height, step = pictures[0].shape[0], pictures[0].shape[1] + GAP_PX
    whole = np.full((height, width, 3), 255, dtype=np.uint8)
    for i, picture in enumerate(pictures):
        whole[:, i * step : i * step + picture.shape[1]] = picture
    return whole


def _build_closed_path(rings: Rings) -> Path:
    """Return rings as one path: each goes back to its first point."""
    starts = rings.starts
    ends = np.append(starts[1:], len(rings.points))
    vertices = np.insert(rings.points, ends, rings.points[starts], axis=0)
    codes = np.full(len(vertices), Path.LINETO, dtype=np.uint8)
    places = np.arange(len(starts))
    codes[starts + places] = Path.MOVETO
    codes[ends + places] = Path.CLOSEPOLY
    return Path(vertices, codes)


@lru_cache(maxsize=4096)
def _lay_out_text(text: str, size_px: float) -> tuple[Path, float]:
    """Return the outline of a text with y up from its base line, and its width [px]."""
    if not text.strip():
        return Path(np.zeros((0, 2))), 0.0
    outline = TextPath((0, 0), text.replace("$", r"\$"), size_px, FontProperties(family="DejaVu Sans", weight="bold"))
    return outline, float(outline.get_extents().x1)


@lru_cache(maxsize=4096)
def _parse_colour(colour: str) -> tuple[float, float, float, float]:
    return to_rgba(colour)


def fade(colour: str, opacity: float) -> str:
    """Return a colour with an opacity in [0, 1]."""
    return to_hex((*to_rgba(colour)[:3], opacity), keep_alpha=True)


def parse_rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour, each 0 to 255."""
    red, green, blue = (round(255 * part) for part in to_rgba(colour)[:3])
    return red, green, blue

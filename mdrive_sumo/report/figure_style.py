"""The style of figures, and their files: PNG and SVG, the same bytes for the same numbers."""

import io
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_bytes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette (Color Universal Design, 2008), safe for colour blindness."""
MARKERS = "os^Dv<>P"
"""One more than colours: 56 pairs differ."""
STYLE: Mapping[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "svg.hashsalt": "mdrive-sumo",
    "text.parse_math": False,  # names of agents may hold dollar signs
}


@contextmanager
def open_figure(width_in: float, height_in: float) -> Generator[Figure]:
    """Yield an empty figure of this size [inch]; what is drawn and saved in the block has `STYLE`."""
    with rc_context(dict(STYLE)):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def render_figure(figure: Figure, kind: str) -> bytes:
    """Return a figure as "png" or "svg". Call it inside `open_figure`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
    return buffer.getvalue()


def save_figure(figure: Figure, stem: Path) -> tuple[Path, Path]:
    """Write STEM.png and STEM.svg and return the paths. Raises InputError. Call it inside `open_figure`."""
    paths = Path(f"{stem}.png"), Path(f"{stem}.svg")
    for path in paths:
        content = render_figure(figure, path.suffix[1:])
        try:
            write_bytes(path, content)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return paths

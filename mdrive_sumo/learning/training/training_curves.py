"""TrainingCurves: losses over steps as CSV, as a picture, and for TensorBoard where it is installed."""

import csv
import io
from collections import defaultdict
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import append_text, make_folder, write_text
from mdrive_sumo.core.tables import format_csv_lines

CURVES_NAME = "curves.csv"


class TrainingCurves:
    """Appends to DIR/curves.csv (step, name, value); a resumed run drops the lines after its checkpoint."""

    def __init__(self, folder: Path, step: int) -> None:
        make_folder(folder)
        self._path = folder / CURVES_NAME
        kept = [row for row in read_curves(self._path) if row[0] <= step] if step else []
        write_text(self._path, format_csv_lines([("step", "name", "value"), *kept]))
        self._board = _open_board(folder)

    def add(self, step: int, values: Mapping[str, float]) -> None:
        """Append the values of a step."""
        lines = [(step, name, f"{value:.6g}") for name, value in values.items()]
        append_text(self._path, format_csv_lines(lines))
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)

    def close(self) -> None:
        """Write DIR/curves.png and end TensorBoard's file."""
        draw_curves(self._path)
        if self._board is not None:
            self._board.close()


def _open_board(folder: Path) -> Any:
    if find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard import SummaryWriter  # here: it is slow to import, and optional

    return SummaryWriter(str(folder / "tensorboard"))


def read_curves(path: Path) -> list[tuple[int, str, float]]:
    """Return the rows of a curves.csv, none if there is no such file."""
    if not path.is_file():
        return []
    rows = csv.DictReader(io.StringIO(read_text(path)))
    return [(int(row["step"]), row["name"], float(row["value"])) for row in rows]


def draw_curves(path: Path) -> None:
    """Draw every curve of a curves.csv into the PNG beside it; training and validation on one panel."""
    from mdrive_sumo.report.figure_style import open_figure, save_figure  # here: matplotlib is slow to import

    points: dict[str, list[tuple[int, float]]] = defaultdict(list)
    for step, name, value in read_curves(path):
        points[name].append((step, value))
    if not points:
        return
    columns = 4
    rows = -(-len(points) // columns)
    with open_figure(3.2 * columns, 2.4 * rows) as figure:
        for i, (name, values) in enumerate(points.items()):
            axes = figure.add_subplot(rows, columns, i + 1)
            axes.plot([step for step, _ in values], [value for _, value in values], linewidth=1.0)
            axes.set_title(name, fontsize="small")
        save_figure(figure, path.with_suffix(""))

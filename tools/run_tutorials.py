"""Execute the notebooks of docs/tutorials and store their outputs: `python -m tools.run_tutorials [--dry-run]`.

Outputs are kept because the site and GitHub show notebooks without executing them.
"""

import base64
import io
import re
import tempfile
from pathlib import Path
from typing import Any

import click
import nbformat
from nbclient import NotebookClient
from PIL import Image

from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
LIMIT_S = 600
"""Seconds that a cell may take."""
MAX_OUTPUT_BYTES = 60_000
"""Of a form of an output: of a larger one, such as a replay page, the text is kept."""
PICTURE_PX, PICTURE_COLOURS = 520, 128
"""Longer side and palette of stored pictures: about 15 KB each."""


def execute_notebook(path: Path, folder: Path) -> Any:
    """Return the notebook with the outputs of an execution in the new folder `folder`, reduced to what readers need."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=LIMIT_S, coalesce_streams=True, resources={"metadata": {"path": str(folder)}}
    ).execute()
    notebook.metadata.pop("language_info", None)  # names the machine's version of Python
    for number, cell in enumerate(cell for cell in notebook.cells if cell.cell_type == "code"):
        cell.execution_count = number + 1
        cell.metadata = {}
        cell.outputs = [reduced for output in cell.outputs if (reduced := _reduce_output(output, folder)) is not None]
    return notebook


def _reduce_output(output: Any, folder: Path) -> Any:
    """Return an output without what differs from run to run; None for what a reader does not need."""
    if output.output_type == "stream" and output.name == "stderr":
        return None
    if "execution_count" in output:
        output.execution_count = None
    if output.output_type == "stream":
        output.text = _hide_places(output.text, folder)
        return output
    if "image/png" in output.data:
        output.data["image/png"] = _shrink_picture(output.data["image/png"])
    output.data = {
        kind: _hide_places(value, folder) for kind, value in output.data.items() if len(value) <= MAX_OUTPUT_BYTES
    }
    return output


def _shrink_picture(png: str) -> str:
    """Return a smaller picture; both as base64."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(png))) as picture:
        small = picture.convert("RGB")
        small.thumbnail((PICTURE_PX, PICTURE_PX), Image.Resampling.LANCZOS)
        small.quantize(PICTURE_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
            buffer, "png", optimize=True
        )
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _hide_places(text: str, folder: Path) -> str:
    """Return the text without the folder of the execution and addresses of objects."""
    return re.sub(r" at 0x[0-9a-f]+", "", text.replace(f"{folder}/", ""))


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Execute the notebooks and store their outputs; takes about a minute."""
    with tempfile.TemporaryDirectory() as scratch:
        built = Path(scratch, "built")
        built.mkdir()
        for path in sorted(TUTORIALS.glob("*.ipynb")):
            folder = Path(scratch, path.stem)
            folder.mkdir()
            nbformat.write(execute_notebook(path, folder), built / path.name)
        replace_changed_files(built, TUTORIALS, dry_run=dry_run)


if __name__ == "__main__":
    main()

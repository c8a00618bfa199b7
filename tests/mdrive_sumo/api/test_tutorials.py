"""The notebooks in docs/tutorials run from top to bottom."""

from pathlib import Path
from typing import Any

import nbformat
import pytest

from tools.run_tutorials import execute_notebook

TUTORIALS = sorted((Path(__file__).parents[3] / "docs" / "tutorials").glob("*.ipynb"))


def list_outputs(notebook: Any) -> list[list[Any]]:
    """What the code cells print and return, as text; pictures and tables for browsers are left out."""
    cells = (cell for cell in notebook["cells"] if cell["cell_type"] == "code")
    return [[output.get("text") or output["data"].get("text/plain") for output in cell["outputs"]] for cell in cells]


def test_there_are_three_tutorials_with_small_outputs() -> None:
    assert len(TUTORIALS) == 3
    for path in TUTORIALS:
        assert len(path.read_bytes()) < 150_000
        notebook = nbformat.read(path, as_version=4)
        assert sum(map(len, list_outputs(notebook))) > 5, path.name


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")  # of the notebook client and its kernel
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs_and_shows_what_it_did_before(path: Path, tmp_path: Path) -> None:
    """After a change on purpose: `python -m tools.run_tutorials`."""
    assert list_outputs(execute_notebook(path, tmp_path)) == list_outputs(nbformat.read(path, as_version=4))

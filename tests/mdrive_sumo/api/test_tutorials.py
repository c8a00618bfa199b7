"""The notebooks in docs/tutorials run from top to bottom."""

import json
from pathlib import Path

import pytest

TUTORIALS = sorted((Path(__file__).parents[3] / "docs" / "tutorials").glob("*.ipynb"))


def test_there_are_three_tutorials_without_outputs() -> None:
    """Outputs would repeat results that are measured elsewhere, and make every change of a notebook unreadable."""
    assert len(TUTORIALS) == 3
    for path in TUTORIALS:
        cells = json.loads(path.read_text("utf-8"))["cells"]
        assert not any(cell.get("outputs") for cell in cells), path.name


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")  # of the notebook client and its kernel
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs(path: Path, tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()

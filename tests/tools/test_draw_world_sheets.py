"""Contact sheets of places and scenarios, and the tables of docs/place-kinds.md."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image
from testing.paths import ROOT

from tools.draw_world_sheets import BEGIN, END, format_kinds, main


def test_the_page_has_the_kinds_of_the_code() -> None:
    """After a change on purpose: `python -m tools.draw_world_sheets page`."""
    text = (ROOT / "docs/place-kinds.md").read_text("utf-8")
    assert text.partition(BEGIN)[2].partition(END)[0].strip() == format_kinds().strip()


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["places", "--kind", "crossing", "--kind", "car_park"], ["scenarios"]])
def test_a_sheet_is_drawn(arguments: list[str], tmp_path: Path) -> None:
    what, *options = arguments
    told = CliRunner().invoke(main, [what, str(tmp_path / "sheet.png"), *options, "--count", "2"])
    assert told.exit_code == 0, told.output
    with Image.open(tmp_path / "sheet.png") as image:
        assert image.width > 1000
        assert len(image.convert("L").getcolors() or ()) > 10


def test_an_unknown_kind_is_named(tmp_path: Path) -> None:
    told = CliRunner().invoke(main, ["places", str(tmp_path / "sheet.png"), "--kind", "castle"])
    assert told.exit_code == 2
    assert "'castle' is not one of 'crossing'" in told.output

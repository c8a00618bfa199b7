"""Which quality.json files a suite has."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from real2sim.pipeline import quality_file
from real2sim.pipeline.quality_file import load_qualities, load_quality


def test_scenarios_come_in_their_natural_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("r10", "r2", "networks", "a"):
        (tmp_path / name).mkdir()
    for name in ("r10", "r2", "a"):
        (tmp_path / name / "quality.json").write_text("{}")
    monkeypatch.setattr(quality_file, "load_quality", lambda path: path.parent.name)
    assert load_qualities(tmp_path) == ("a", "r2", "r10")


def test_a_suite_without_them_is_refused_and_one_of_authored_scenes_has_conversion_md(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere: expected a suite folder, found none$"):
        load_qualities(tmp_path / "nowhere")
    with pytest.raises(
        InputError, match=r"expected quality\.json beside scenario\.json of converted logs, found none$"
    ):
        load_qualities(tmp_path)
    (tmp_path / "conversion.md").write_text("")
    with pytest.raises(InputError, match=r"found none \(authored sources have conversion\.md instead\)$"):
        load_qualities(tmp_path)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"format": "mdrive-sumo/quality/1"}', '{"format": "mdrive-sumo/quality/9"}']
)
def test_a_damaged_file_is_one_sentence_with_its_path(text: str, tmp_path: Path) -> None:
    path = tmp_path / "quality.json"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_quality(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)

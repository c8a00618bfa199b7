"""Paths from a stranger's files."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import restore_path


def test_a_path_is_found_from_a_folder_or_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "suite").mkdir()
    assert restore_path("../suite", tmp_path / "run") == tmp_path / "suite"
    (tmp_path / "here" / "moved").mkdir()
    assert restore_path("../moved", tmp_path / "run") == tmp_path / "here" / "moved"


@pytest.mark.parametrize("text", ["a\0b", "\ud800", "x" * 5000])
def test_what_is_no_path_costs_one_sentence(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="expected the path of a file or a folder, found '"):
        restore_path(text, tmp_path)

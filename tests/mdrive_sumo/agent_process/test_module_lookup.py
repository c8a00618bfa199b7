"""Where the file of a module is, found without an import: the module may be a stranger's."""

import sys
from pathlib import Path

import pytest

from mdrive_sumo.agent_process.agent_lookup import find_module_file
from mdrive_sumo.core.errors import InputError

RAISES = "raise RuntimeError('imported')\n"


@pytest.mark.parametrize(
    ("module", "file"),
    [
        ("strange_package.agent", "strange_package/agent.py"),
        ("strange_package.inner", "strange_package/inner/__init__.py"),
        ("strange_package.math", "strange_package/math.py"),  # as one that is built into Python
        ("strange_folder.inner.agent", "strange_folder/inner/agent.py"),  # namespace packages
        ("strange_folder.inner.agent.Driver", None),
        ("strange_folder.none", None),
        ("strange_none.agent", None),
    ],
)
def test_a_module_is_found_as_import_would(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, file: str | None
) -> None:
    for name in ("strange_package/inner", "strange_folder/inner"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("__init__", "agent", "math", "inner/__init__"):
        (tmp_path / "strange_package" / f"{name}.py").write_text(RAISES)
    (tmp_path / "strange_folder" / "inner" / "agent.py").write_text(RAISES)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = {*sys.modules}
    assert find_module_file(module) == (None if file is None else tmp_path / file)
    assert not [name for name in {*sys.modules} - before if name.startswith("strange")]


@pytest.mark.parametrize("module", ["sys", "strange_folder", "strange_folder.inner"])
def test_a_module_without_a_file_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str) -> None:
    (tmp_path / "strange_folder" / "inner").mkdir(parents=True)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="expected a Python file, found a module without one"):
        find_module_file(module)

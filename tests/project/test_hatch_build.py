"""Installing with and without a compiler that can build."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from testing.paths import ROOT

import hatch_build
from mdrive_sumo.core.version import __version__

SOURCE = '__attribute__((visibility("default"))) const char *version(void) { return MDRIVE_VERSION MDRIVE_SOURCES; }\n'


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with one C file."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(ROOT / hatch_build.CACHE))
    package = tmp_path / "mdrive_sumo/core"
    (package / "compiled").mkdir(parents=True)
    (package / "version.py").write_text((ROOT / "mdrive_sumo/core/version.py").read_text())
    (package / "part.c").write_text(SOURCE)
    return tmp_path


@contextmanager
def install(project: Path, version: str) -> Iterator[tuple[dict[str, Any], list[str]]]:
    """What the hook adds to the data of a build, and what it says."""
    words: list[str] = []
    app = SimpleNamespace(display_warning=words.append)
    hook = hatch_build.CompiledLayer(str(project), {}, None, None, "", "wheel", app)
    data: dict[str, Any] = {"force_include": {}}
    hook.initialize(version, data)
    yield data, words
    hook.finalize(version, data, "")


def test_a_wheel_has_the_layer_and_says_for_which_machines(project: Path) -> None:
    with install(project, "standard") as (data, words):
        ((built, inside),) = data["force_include"].items()
        assert words == []
        assert inside == "mdrive_sumo/core/compiled/layer.abi3.so"
        assert f"{__version__}{hatch_build.describe_sources(project)[1]}".encode() in Path(built).read_bytes()
        assert (data["pure_python"], data["tag"].startswith("cp311-abi3-manylinux_2_17_")) == (False, True)
    assert not Path(built).parent.exists()


def test_an_editable_installation_has_it_in_the_clone(project: Path) -> None:
    with install(project, "editable") as (data, words):
        assert (data["force_include"], words) == ({}, [])
    assert (project / hatch_build.LAYER).is_file()


def test_a_changed_source_has_another_digest(project: Path) -> None:
    before = hatch_build.describe_sources(project)
    (project / "mdrive_sumo/core/part.c").write_text(SOURCE.replace("version", "release"))
    assert hatch_build.describe_sources(project) != before


@pytest.mark.parametrize("trouble", ["source", "platform", "compiler"])
def test_without_a_compiler_that_can_build_one_line_says_so(
    trouble: str, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if trouble == "source":
        (project / "mdrive_sumo/core/part.c").write_text("no C at all")
    if trouble == "platform":
        monkeypatch.setattr(sys, "platform", "win32")
    if trouble == "compiler":
        monkeypatch.setattr(sys, "executable", str(project / "no-python"))
    with install(project, "standard") as (data, words):
        assert data == {"force_include": {}}
    assert len(words) == 1 and words[0].startswith("mdrive-sumo: no compiled layer, same results but slower: ")
    assert "\n" not in words[0]

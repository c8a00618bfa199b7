"""Unpacked images as environments: what they hold is asked in a box; their agents see them and nothing of the host."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.archive_samples import GOOD, packed, written
from testing.sandbox_runs import needs_bubblewrap

from mdrive_sumo.agent_process.sandbox import BoxSpec
from mdrive_sumo.core.errors import InputError
from server import environments
from server.archive import ArchiveLimits, check_archive
from server.cli import admin
from server.environments import Environment, EnvironmentRecipe, import_image, load_environment
from server.submitted_agent import SubmittedAgent

PYTHON = "/usr/bin/python3"
HOST = Path("/")
"""The host itself is an image too: it has a folder usr."""
pytestmark = [pytest.mark.slow, needs_bubblewrap]


@pytest.fixture(autouse=True)
def recipes(monkeypatch: pytest.MonkeyPatch) -> None:
    """`mine` fits, `other` wants another Python, `more` a package that is not there."""
    said = "import sys; print('%d.%d' % sys.version_info[:2])"
    version = subprocess.run((PYTHON, "-c", said), capture_output=True, text=True, check=True).stdout.strip()
    memory = 512 * environments.MEBIBYTE
    mine = EnvironmentRecipe("mine", version, (), memory)
    made = (mine, replace(mine, name="other", python="2.7"), replace(mine, name="more", packages=("absent==1.0",)))
    monkeypatch.setattr(environments, "RECIPES", {recipe.name: recipe for recipe in made})


@pytest.mark.full
def test_an_imported_image_is_found_again_and_may_be_replaced(tmp_path: Path) -> None:
    made = import_image("mine", tmp_path, HOST, PYTHON)
    assert (made.python, made.site, made.rootfs) == (Path(PYTHON), None, HOST)
    assert load_environment("mine", tmp_path) == made
    assert import_image("mine", tmp_path, HOST, PYTHON) == made


def test_an_image_is_known_by_its_programs(tmp_path: Path) -> None:
    def checksum() -> str:
        return environments._checksum_programs(tmp_path)

    library = tmp_path / "usr" / "lib" / "libblas.so"
    library.parent.mkdir(parents=True)
    library.write_bytes(b"one")
    seen = [checksum()]
    library.write_bytes(b"newer")
    seen.append(checksum())
    library.rename(library.with_name("libother.so"))
    seen.append(checksum())
    assert checksum() == seen[-1]
    assert len(set(seen)) == 3


@pytest.mark.parametrize(
    ("name", "rootfs", "python", "expected"),
    [
        ("perl", HOST, PYTHON, r"^environment: expected one of mine, other, more, found 'perl'$"),
        ("other", HOST, PYTHON, r"^environment other: expected Python 2\.7 in /, found 3\.\d+$"),
        ("more", HOST, PYTHON, r"^environment more: expected absent==1\.0 in /, found \S"),
        (
            "mine",
            HOST,
            "/usr/bin/env",
            r"^environment mine: /usr/bin/env of / does not list .*invalid option",
        ),
        (
            "mine",
            HOST,
            "/usr/bin/nothing",
            r"^environment mine: /usr/bin/nothing of / does not list .*No such file",
        ),
        ("mine", Path("/etc"), PYTHON, r"expected an unpacked image with a folder usr in /etc"),
    ],
)
def test_images_that_do_not_fit_are_refused(
    name: str, rootfs: Path, python: str, expected: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=expected):
        import_image(name, tmp_path, rootfs, python)
    assert list(tmp_path.iterdir()) == []


def test_what_was_built_here_is_not_replaced(tmp_path: Path) -> None:
    note = tmp_path / "mine" / environments.ABOUT_FILE
    note.parent.mkdir()
    note.write_text('{"name": "mine", "python": "/p", "site": "/s", "packages": []}')
    with pytest.raises(InputError, match=r"^environment mine: built in .*; remove .*mine to import an image in its"):
        import_image("mine", tmp_path, HOST, PYTHON)
    assert load_environment("mine", tmp_path).rootfs is None


def test_an_image_that_says_nothing_is_no_environment(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not list its packages: no output"):
        import_image("mine", tmp_path, HOST, "/usr/bin/true")


@pytest.mark.full
def test_the_command_notes_it_in_the_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MDRIVE_SETTINGS", raising=False)
    words = ("--data", str(tmp_path), "environment", "import", "mine", "/", "--python", PYTHON)
    found = CliRunner().invoke(admin, words, catch_exceptions=False)
    assert found.output.startswith("mine  ") and found.output.endswith(" packages  /\n")
    listed = CliRunner().invoke(admin, ("--data", str(tmp_path), "environment", "list"), catch_exceptions=False)
    assert "mine  built" in listed.output


def test_the_limits_are_those_of_the_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[BoxSpec] = []

    def refused(spec: BoxSpec) -> None:
        seen.append(spec)
        raise InputError("no box")

    monkeypatch.setattr(environments, "open_box", refused)
    monkeypatch.delenv("MDRIVE_SETTINGS", raising=False)
    monkeypatch.setenv("MDRIVE_SANDBOX__PROCESSES", "333")
    monkeypatch.setenv("MDRIVE_SANDBOX__MEMORY_BYTES", "1")
    words = ("--data", str(tmp_path), "environment", "import", "mine", "/")
    assert str(CliRunner().invoke(admin, words).exception) == "no box"
    ((limits, command),) = [(spec.limits, spec.command[0]) for spec in seen]
    assert (limits.processes, limits.memory_bytes) == (333, environments.RECIPES["mine"].memory_bytes)
    assert command == environments.IMAGE_PYTHON


def test_agents_of_an_imported_environment_see_the_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    manifest = check_archive(written(tmp_path, packed(GOOD)), ArchiveLimits())
    image = Environment("python3.11-numpy", Path(environments.IMAGE_PYTHON), None, (), tmp_path)
    plan = SubmittedAgent(manifest, tmp_path, image).agent_box()
    assert plan is not None
    assert (plan.rootfs, plan.python, plan.site) == (tmp_path, environments.IMAGE_PYTHON, None)
    site = replace(image, rootfs=None, site=Path("/site"))
    plan = SubmittedAgent(manifest, tmp_path, site).agent_box()
    assert plan is not None and (plan.rootfs, plan.site) == (None, Path("/site"))

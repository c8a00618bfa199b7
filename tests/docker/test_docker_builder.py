"""The script that builds a participant's Dockerfile: what it refuses, and what is left when a build fails."""

import subprocess
from pathlib import Path

import pytest
from testing.paths import ROOT

SCRIPT = ROOT / "docker" / "build-agent.sh"
BUILDAH = """#!/bin/sh
echo "$@"
for word; do case $word in type=tar,dest=*) echo rootfs >"${word#type=tar,dest=}";; esac; done
exit RESULT
"""
"""A stand-in; the real one is used in `test_docker.py`."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "submission").mkdir()
    (tmp_path / "submission" / "Dockerfile").write_text("FROM scratch\n")
    (tmp_path / "bin").mkdir()
    for name in ("rm", "mv"):
        (tmp_path / "bin" / name).symlink_to(f"/bin/{name}")
    return tmp_path


def program(folder: Path, name: str, text: str) -> None:
    (folder / "bin" / name).write_text(text)
    (folder / "bin" / name).chmod(0o755)


def build(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command, path = ("/bin/sh", str(SCRIPT), *words), {"PATH": str(folder / "bin")}
    return subprocess.run(command, cwd=folder, env=path, capture_output=True, text=True, check=False)


def test_it_builds_and_exports(folder: Path) -> None:
    program(folder, "buildah", BUILDAH.replace("RESULT", "0"))
    done = build(folder, "submission", "red.tar", "--isolation", "chroot")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == (
        "bud --output type=tar,dest=red.tar.part --isolation chroot --file submission/Dockerfile submission\n"
    )
    assert sorted(path.name for path in folder.glob("red*")) == ["red.tar"]


def test_a_build_that_fails_leaves_nothing(folder: Path) -> None:
    program(folder, "buildah", BUILDAH.replace("RESULT", "3"))
    assert build(folder, "submission", "red.tar").returncode == 3
    assert not list(folder.glob("red*"))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("submission", "expected a folder and a new file"),
        ("bin red.tar", "bin: expected a folder with a Dockerfile, found none"),
        ("submission submission/Dockerfile", "submission/Dockerfile: expected a new file"),
        ("submission red.tar", "expected buildah, found none"),
    ],
)
def test_what_it_cannot_build_is_said(folder: Path, words: str, expected: str) -> None:
    done = build(folder, *words.split())
    assert done.returncode == 2 and f"build-agent: {expected}" in done.stderr


def test_a_machine_that_evaluates_is_refused(folder: Path) -> None:
    program(folder, "buildah", BUILDAH.replace("RESULT", "0"))
    program(folder, "mdrive-sumo", "#!/bin/sh\n")
    done = build(folder, "submission", "red.tar")
    assert done.returncode == 2 and "a machine that evaluates or serves is not one" in done.stderr
    assert done.stdout == "" and not list(folder.glob("red*"))

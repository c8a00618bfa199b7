"""Which of the host's programs a box with files of its own gets."""

import subprocess
import sys
from pathlib import Path

import pytest

from mdrive_sumo.agent_process.sandbox.runtime_files import find_libraries, is_unused, list_runtime_paths, read_needed


def test_the_libraries_of_a_program_are_those_that_its_loader_names() -> None:
    """The independent oracle is `ldd`, which runs the loader."""
    program = Path("/bin/ls").resolve()
    found = subprocess.run(("ldd", str(program)), capture_output=True, text=True, check=True).stdout
    wanted = {Path(word).resolve() for word in found.split() if word.startswith("/")}
    assert {path.resolve() for path in find_libraries([program])} == wanted


@pytest.mark.parametrize("content", [b"", b"\x7fELF", b"#!/bin/sh\n", b"\x7fELF\x02\x01" + bytes(10), bytes(200)])
def test_what_is_no_program_needs_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file").write_bytes(content)
    assert read_needed(tmp_path / "file") == read_needed(tmp_path / "absent") == ()


def test_every_link_leads_to_something_that_is_listed() -> None:
    paths = set(list_runtime_paths(str(Path(sys.executable).resolve())))
    assert Path("/usr/bin/sh") in paths
    for path in paths:
        if path.is_symlink():
            target = path.parent / path.readlink()
            assert target.parent.resolve() / target.name in paths, path


@pytest.mark.parametrize(
    ("path", "unused"),
    [
        ("lib/python3.11/test", True),
        ("lib/python3.11/site-packages", True),
        ("lib/python3.11/json", False),
        ("lib/python3.11/__pycache__/ast.cpython-311.opt-1.pyc", True),
        ("lib/libpython3.11.a", True),
        ("lib/libpython3.11.so.1.0", False),
        ("lib", False),
        ("bin", False),
        ("bin/pip3", True),
        ("bin/python3.11", False),
        ("include", True),
    ],
)
def test_of_an_interpreter_only_what_agents_run_is_copied(path: str, unused: bool) -> None:
    assert is_unused(Path(path)) is unused

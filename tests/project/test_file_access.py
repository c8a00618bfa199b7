"""Files are written, and text is printed, in one way: `core.output_files` and `core.terminal`.

A stranger's run folder may hold links, pipes and escape sequences wherever a file is written or a name is shown.
"""

import ast
import re
from collections.abc import Callable, Iterator

import pytest
from testing.paths import ROOT
from testing.source_trees import parse_source

PACKAGES = ("mdrive_sumo", "real2sim", "server", "tools", "networks")
WRITERS = {
    "mdrive_sumo/core/output_files.py": "the way itself",
    "mdrive_sumo/agent_process/frame_file.py": "exclusive files in a new folder of its own, shared with one agent",
    "mdrive_sumo/agent_process/remote_driver.py": "a pipe to an agent in a new temporary folder",
    "mdrive_sumo/agent_process/sandbox/": "files of the kernel, and new folders that become a box",
    "mdrive_sumo/report/figure_style.py": "a figure in memory",
    "mdrive_sumo/report/scenario_plot.py": "a figure in a new file",
    "server/store/backup.py": "a copy in a new temporary folder",
    "real2sim/recorded_drives/convert_recording.py": "a link to a network in a new folder",
    "server/evaluation/phase_separation.py": "a file of the kernel",
    "server/store/engine.py": "a database of the organiser, which SQLite writes in its place",
    "server/archive/extraction.py": "exclusive files in a new folder, names checked before",
    "server/participant/packaging.py": "a zip in a new temporary folder",
}
"""Modules that open files for writing themselves, and why."""
PRINTERS = {
    "mdrive_sumo/core/terminal.py": "the way itself",
    "mdrive_sumo/api/open_evaluation.py": "a count and ids of scenarios that this process has loaded",
}
IN_PLACE = {"write_text", "write_bytes", "touch", "savefig", "to_csv", "symlink_to", "hardlink_to", "tofile"}
COPIES = {"copyfile", "copy", "copy2", "move"}
FLAGS = {"O_WRONLY", "O_RDWR", "O_CREAT", "O_APPEND"}
SOURCES = [
    path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if "samples" not in path.relative_to(ROOT).parts
]


WRITES = re.compile(rf"\b(open|ZipFile|exist_ok|shutil|{'|'.join(sorted(IN_PLACE))})\b")
PRINTS = re.compile(r"\b(click|print)\b")
"""Names that every line has that `find_writing` or `find_printing` yields: files without them are not parsed."""


def find_all(find: Callable[[ast.Module], Iterator[str]], names: re.Pattern[str]) -> dict[str, list[str]]:
    """Return what is found in each file, if there is anything."""
    found: dict[str, list[str]] = {}
    for path in SOURCES:
        if names.search(path.read_text("utf-8")) and (problems := [*find(parse_source(path))]):
            found[str(path.relative_to(ROOT))] = problems
    return found


def find_writing(tree: ast.Module) -> Iterator[str]:
    """Yield every call that opens a file for writing, follows a link to a folder, or copies over a file."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr=name)) if name in IN_PLACE:
                yield f"{node.lineno}: {name}"
            case ast.Call(func=ast.Attribute(attr=name, value=ast.Name("shutil"))) if name in COPIES:
                yield f"{node.lineno}: shutil.{name}"
            case ast.Call(func=ast.Attribute(attr="open", value=ast.Name("os"))):
                if FLAGS & {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}:
                    yield f"{node.lineno}: os.open for writing"
            case ast.Call(func=ast.Attribute(attr="open" | "ZipFile") | ast.Name("open" | "ZipFile")):
                if _is_writing(node):
                    yield f"{node.lineno}: open for writing"
            case ast.Call(func=ast.Attribute(attr="mkdir"), keywords=options) if any(
                one.arg == "exist_ok" for one in options
            ):
                yield f"{node.lineno}: mkdir(exist_ok=...)"
            case _:
                pass


def _is_writing(call: ast.Call) -> bool:
    """Whether a mode of a call of `open` writes over a file; "x" is exclusive and follows no link."""
    if (
        isinstance(call.func, ast.Attribute)
        and isinstance(call.func.value, ast.Name)
        and call.func.value.id == "tarfile"
    ):
        return False  # tar files are written into a file object
    given = (*call.args, *(one.value for one in call.keywords if one.arg == "mode"))
    modes = [one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    is_object = bool(call.args) and ast.unparse(call.args[0]).split(".")[-1] in ("file", "os.open")
    return any(set(mode) & set("wa+") and len(mode) <= 3 for mode in modes) and not is_object


def find_printing(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr="echo" | "secho" | "echo_via_pager", value=ast.Name("click")):
                yield f"{node.lineno}: click.{node.attr}"
            case ast.Call(func=ast.Name("print")):
                yield f"{node.lineno}: print"
            case _:
                pass


@pytest.mark.parametrize(
    "text",
    [
        'path.write_text("x")', "path.write_bytes(b'')", 'open(path, "w")', 'path.open("ab")', 'path.open(mode="r+")',
        "os.open(path, os.O_RDWR)", "folder.mkdir(exist_ok=True)", "shutil.copyfile(a, b)", "figure.savefig(path)",
        'ZipFile(path, "w")', 'zipfile.ZipFile(path, "a")',
    ],
)  # fmt: skip
def test_writing_is_found(text: str) -> None:
    assert WRITES.search(text)
    assert list(find_writing(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        'open(path)', 'path.open("rb")', 'path.open("xb")', "folder.mkdir()", "os.open(path, os.O_RDONLY)",
        "write_text(path, text)", 'ZipFile(new.file, "w")',
    ],
)  # fmt: skip
def test_reading_and_new_files_are_not(text: str) -> None:
    assert not list(find_writing(ast.parse(text)))


def test_files_are_written_in_one_way() -> None:
    found = find_all(find_writing, WRITES)
    unknown = {path: problems for path, problems in found.items() if not path.startswith((*WRITERS,))}
    assert not unknown, f"use mdrive_sumo.core.output_files: {unknown}"
    assert not [path for path in WRITERS if not any(one.startswith(path) for one in found)], "exceptions that are none"


def test_text_is_printed_in_one_way() -> None:
    found = find_all(find_printing, PRINTS)
    unknown = {path: problems for path, problems in found.items() if path not in PRINTERS}
    assert not unknown, f"use mdrive_sumo.core.terminal: {unknown}"
    assert not {*PRINTERS} - {*found}, "exceptions that are none"

"""Names and sizes: one meaning for each public class name, plain words, small files and functions."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from testing.paths import ROOT, TESTS
from testing.source_trees import parse_source

PACKAGES = ("mdrive_sumo", "networks", "real2sim", "server", "tools")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py") if "samples" not in path.parts)
TEST_FILES = sorted(TESTS.rglob("*.py"))
RECORDED_TEXTS = ("mdrive_sumo/negotiation/prompt.py", "mdrive_sumo/generate/template_proposer.py")
"""Texts that transcripts and recipes repeat byte for byte."""
PRONOUNS = re.compile(r"\b(nobody|somebody|everybody|whom|whoever)\b", re.IGNORECASE)
"""Words for people, which stand for vehicles, messages and files nowhere."""
MAX_FILE_LINES, MAX_BODY_LINES = 400, 40
"""Lines of a file, and of the body of a function without its docstring: a file holds one subject, and longer ones have
held two so far."""


def statements(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """All statements of a body and those inside them; expressions hold none, and are most of a tree."""
    for node in body:
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, part, ()))


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in statements(tree.body) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


@pytest.mark.slow
def test_a_public_class_name_has_one_meaning() -> None:
    files_by_class: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        for node in statements(parse_source(path).body):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                files_by_class[node.name].append(str(path.relative_to(ROOT)))
    assert {name: files for name, files in files_by_class.items() if len(files) > 1} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_vehicles_and_data_are_not_called_people(package: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in SOURCES
        if path.is_relative_to(ROOT / package) and str(path.relative_to(ROOT)) not in RECORDED_TEXTS
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        if PRONOUNS.search(line)
    ]
    assert found == []


@pytest.mark.slow
def test_files_and_functions_are_small() -> None:
    long: list[str] = []
    for path in SOURCES:
        text = path.read_text("utf-8")
        if text.count("\n") > MAX_FILE_LINES:
            long.append(f"{path.relative_to(ROOT)}: {text.count(chr(10))} lines")
        for function in functions(parse_source(path)):
            body = function.body[1:] if ast.get_docstring(function) else function.body
            lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
            if lines > MAX_BODY_LINES:
                long.append(f"{path.relative_to(ROOT)}:{function.lineno} {function.name}: {lines} lines")
    assert long == []


def test_test_files_are_small() -> None:
    lines_by_file = {str(path.relative_to(ROOT)): path.read_text("utf-8").count("\n") for path in TEST_FILES}
    assert {path: lines for path, lines in lines_by_file.items() if lines > MAX_FILE_LINES} == {}


def test_packages_only_export() -> None:
    """An `__init__.py` holds a docstring, imports and `__all__`; only the front door has lazy exports."""
    allowed = (ast.Import, ast.ImportFrom, ast.Assign, ast.AnnAssign, ast.Expr)
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        if path.name == "__init__.py" and path != ROOT / "mdrive_sumo" / "__init__.py"
        for node in parse_source(path).body
        if not isinstance(node, allowed)
    ]
    assert found == []


def test_the_front_door_holds_no_classes(path: Path = ROOT / "mdrive_sumo" / "__init__.py") -> None:
    body = ast.parse(path.read_text("utf-8")).body
    assert [node.name for node in body if isinstance(node, ast.ClassDef)] == []

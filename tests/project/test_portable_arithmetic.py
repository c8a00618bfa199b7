"""What reaches an episode or a score has the same bits on every machine: operators and sorts that ruff cannot name.

Functions are refused by ruff (`banned-api` in pyproject.toml); `mdrive_sumo.core.portable` has their equals.
"""

import ast
import tomllib
from collections.abc import Iterator

import pytest
from testing.paths import ROOT
from testing.source_trees import parse_source

FREE = ("report/", "roads/drawing/", "sensing/camera/", "study/plots.py")
"""Figures and pages: they show numbers and decide nothing. Images of cameras depend on the driver anyway."""
LIBRARY = ROOT / "mdrive_sumo"
SOURCES = [path for path in sorted(LIBRARY.rglob("*.py")) if not str(path.relative_to(LIBRARY)).startswith(FREE)]


def find_problems(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                yield f"{node.lineno}: a matrix product: portable.dot"
            case ast.BinOp(left=base, op=ast.Pow(), right=exponent) if not (is_number(base) and is_number(exponent)):
                yield f"{node.lineno}: a power: x * x or portable.square"
            case ast.AugAssign(op=ast.Pow()):
                yield f"{node.lineno}: a power: x * x or portable.square"
            case ast.Call(func=ast.Attribute(attr="argsort" | "sort" as name, value=owner), keywords=options):
                if (name == "argsort" or is_numpy(owner)) and not any(is_stable(option) for option in options):
                    yield f'{node.lineno}: {name} without kind="stable"'
            case _:
                pass


def is_number(node: ast.expr) -> bool:
    """Whether the compiler computes it, or it is an integer by its name."""
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id == "bits")


def is_numpy(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id in ("np", "numpy")


def is_stable(option: ast.keyword) -> bool:
    return option.arg == "kind" and isinstance(option.value, ast.Constant) and option.value.value == "stable"


@pytest.mark.parametrize(
    "text",
    [
        "a @ b",
        "x **= 2",
        "speed ** 2",
        "2**share",
        "np.argsort(x)",
        "x.argsort()",
        "np.sort(x)",
        'np.sort(x, kind="heap")',
    ],
)
def test_operations_that_differ_are_found(text: str) -> None:
    assert list(find_problems(ast.parse(text))) != []


@pytest.mark.parametrize("text", ["2.0**-53", "2**bits", 'np.argsort(x, kind="stable")', "names.sort()", "x * x"])
def test_operations_that_agree_are_accepted(text: str) -> None:
    assert list(find_problems(ast.parse(text))) == []


@pytest.mark.slow
def test_the_library_uses_operations_with_the_same_bits_everywhere() -> None:
    assert len(SOURCES) > 200
    problems = {str(path.relative_to(ROOT)): list(find_problems(parse_source(path))) for path in SOURCES}
    assert {path: found for path, found in problems.items() if found} == {}


def test_ruff_refuses_functions_that_differ() -> None:
    """The list in pyproject.toml reaches a module of the library, and free modules are few."""
    ruff = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    banned = ruff["flake8-tidy-imports"]["banned-api"]
    assert {"math.sin", "numpy.exp", "numpy.arctan2", "numpy.einsum", "numpy.convolve"} <= set(banned)
    assert "TID251" in ruff["select"]
    free = {pattern for pattern, rules in ruff["per-file-ignores"].items() if "TID251" in rules}
    assert {pattern for pattern in free if pattern.startswith("mdrive_sumo")} == {
        "mdrive_sumo/report/**",
        "mdrive_sumo/roads/drawing/**",
        "mdrive_sumo/sensing/camera/**",
        "mdrive_sumo/study/plots.py",
    }

"""Small changes of source text, each of which a test should notice: comparisons, constants, conditions, arithmetic.

Mutation testing after DeMillo, Lipton and Sayward, Hints on Test Data Selection, Computer 1978.
"""

import ast
import hashlib
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

FLOAT_FACTOR = 1.3
"""Chosen: far enough from 1 that tolerances do not hide it, near enough that a rough bound does."""
ROUNDING = 1e-4
"""Smaller floats guard against rounding: another value of the same size does the same."""
NEGATED = {"<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "==", "is": "is not", "is not": "is"} | {
    "in": "not in",
    "not in": "in",
}
ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "&": "|", "|": "&"}
SYMBOLS: dict[type[ast.AST], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Is: "is",
    ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in", ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
    ast.FloorDiv: "//", ast.Mod: "%", ast.BitAnd: "&", ast.BitOr: "|", ast.And: "and", ast.Or: "or",
}  # fmt: skip
CHECKING_KEYWORDS = {"strict", "frozen", "slots", "eq", "deadline"}
"""Arguments that check or save and compute nothing: `zip(strict=True)`, options of dataclasses."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one file."""

    path: str
    """Relative to the root of the tree."""
    start: int
    """First byte that is replaced."""
    old: str
    new: str
    line: int
    line_text: str
    """The line of source that holds the first byte, without its indentation."""
    repetition: int = 0
    """Number of equal changes of equal lines before it in the file."""

    @property
    def name(self) -> str:
        """What it changes, independent of the number of its line: unique among the mutants of a tree."""
        again = f" ({self.repetition + 1})" if self.repetition else ""
        return f"{self.path}: {self.line_text}: {' '.join(self.old.split())} -> {' '.join(self.new.split())}{again}"

    def apply(self, source: bytes) -> bytes:
        """Return the changed source."""
        old = self.old.encode()
        assert source[self.start : self.start + len(old)] == old, f"{self.path}:{self.line} is another text"
        return source[: self.start] + self.new.encode() + source[self.start + len(old) :]


def list_mutants(root: Path, files: Iterable[Path]) -> list[Mutant]:
    """Return all mutants of the files, in their order."""
    return [mutant for file in files for mutant in mutate_source(file.read_bytes(), file.relative_to(root).as_posix())]


def mutate_source(source: bytes, path: str) -> list[Mutant]:
    """Return all mutants of one module, in the order of their text."""
    found = sorted(_Mutator(source, path).list_all(), key=lambda mutant: (mutant.start, mutant.old, mutant.new))
    seen: Counter[str] = Counter()
    numbered: list[Mutant] = []
    for mutant in found:
        numbered.append(replace(mutant, repetition=seen[mutant.name]))
        seen[mutant.name] += 1
    return numbered


def sample_mutants(mutants: Sequence[Mutant], count: int, seed: int) -> list[Mutant]:
    """Return `count` of the mutants, by a hash of seed and name: a change elsewhere does not change the choice."""
    return sorted(mutants, key=lambda one: hashlib.sha256(f"{seed}: {one.name}".encode()).digest())[:count]


class _Mutator:
    def __init__(self, source: bytes, path: str) -> None:
        self._source, self._path = source, path
        self._lines = source.splitlines(keepends=True)
        self._line_starts = [0]
        for line in self._lines:
            self._line_starts.append(self._line_starts[-1] + len(line))

    def list_all(self) -> Iterator[Mutant]:
        yield from self._walk(ast.parse(self._source), is_in_function=False)

    def _walk(self, node: ast.AST, is_in_function: bool) -> Iterator[Mutant]:
        yield from self._mutate(node, is_in_function)
        for child in _list_computing_parts(node):
            yield from self._walk(child, is_in_function or isinstance(node, ast.FunctionDef | ast.Lambda))

    def _mutate(self, node: ast.AST, is_in_function: bool) -> Iterator[Mutant]:
        match node:
            case ast.Compare():
                yield from self._swap_between([node.left, *node.comparators], node.ops, NEGATED)
            case ast.BoolOp():
                operators = [node.op] * (len(node.values) - 1)
                yield from self._swap_between(node.values, operators, {"and": "or", "or": "and"})
            case ast.BinOp() if is_in_function or not isinstance(node.op, ast.BitOr):  # at module level a type
                yield from self._swap_between([node.left, node.right], [node.op], ARITHMETIC)
            case ast.AugAssign():
                yield from self._swap_between([node.target, node.value], [node.op], ARITHMETIC)
            case ast.If() | ast.IfExp():
                yield from self._negate(node.test)
            case ast.comprehension():
                for condition in node.ifs:
                    yield from self._negate(condition)
            case ast.Constant() | ast.UnaryOp() | ast.Call():
                yield from self._mutate_value(node)
            case _:
                pass

    def _mutate_value(self, node: ast.expr) -> Iterator[Mutant]:
        match node:
            case ast.Constant(value=bool() as value):
                yield self._replace(node, str(not value))
            case ast.Constant(value=int() as value):
                yield self._replace(node, str(value + 1))
            case ast.Constant(value=float() as value) if value == 0.0 or abs(value) >= ROUNDING:
                yield self._replace(node, repr(round(value * FLOAT_FACTOR, 9) if value else 1.0))
            case ast.UnaryOp(op=ast.Not() | ast.USub()):
                yield self._replace(node, f"({self._text(node.operand)})")
            case ast.Call(func=ast.Name(id="min" | "max") as function):
                yield self._replace(function, {"min": "max", "max": "min"}[function.id])
            case _:
                pass

    def _swap_between(
        self, operands: Sequence[ast.expr], operators: Sequence[ast.AST], swaps: dict[str, str]
    ) -> Iterator[Mutant]:
        """Yield one mutant per operator; it stands in the text between its operands, which may hold parentheses."""
        for left, right, operator in zip(operands[:-1], operands[1:], operators, strict=True):
            symbol = SYMBOLS.get(type(operator), "")
            if symbol not in swaps:
                continue
            begin, end = self._end(left), self._start(right)
            pattern = r"\s+".join(map(re.escape, symbol.split()))
            place = re.search(pattern.encode(), self._source[begin:end])
            assert place is not None, f"{self._path}:{left.lineno}: no {symbol}"
            yield self._build(begin + place.start(), place.group().decode(), swaps[symbol])

    def _negate(self, condition: ast.expr) -> Iterator[Mutant]:
        """Yield the negation of a condition that no other mutant negates: neither one comparison nor `not x`."""
        if isinstance(condition, ast.Name) and condition.id == "TYPE_CHECKING":
            return
        is_single = isinstance(condition, ast.Compare) and len(condition.ops) == 1
        if not is_single and not (isinstance(condition, ast.UnaryOp) and isinstance(condition.op, ast.Not)):
            yield self._replace(condition, f"(not ({self._text(condition)}))")

    def _replace(self, node: ast.expr, new: str) -> Mutant:
        return self._build(self._start(node), self._text(node), new)

    def _build(self, start: int, old: str, new: str) -> Mutant:
        line = bisect_right(self._line_starts, start)
        return Mutant(self._path, start, old, new, line, self._lines[line - 1].decode().strip())

    def _start(self, node: ast.expr) -> int:
        return self._line_starts[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._line_starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, node: ast.expr) -> str:
        return self._source[self._start(node) : self._end(node)].decode()


def _list_computing_parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the children that compute: no annotations, decorators, texts, nor arguments that only check."""
    if isinstance(node, ast.JoinedStr):  # before Python 3.12 its parts have no true places
        return
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "bases", "keywords") and isinstance(node, ast.ClassDef):
            continue
        if field in ("annotation", "returns", "decorator_list", "type_comment"):
            continue
        for child in value if isinstance(value, list) else (value,):
            if isinstance(child, ast.keyword) and child.arg in CHECKING_KEYWORDS:
                continue
            if isinstance(child, ast.AST):
                yield child

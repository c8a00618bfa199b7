"""Syntax trees of source files, made once for all tests that read them. No tests in here."""

import ast
from functools import cache
from pathlib import Path


@cache
def parse_source(path: Path) -> ast.Module:
    """Return the tree of a Python file; it must not be changed."""
    return ast.parse(path.read_text("utf-8"))

"""Untrusted XML: document types are refused because they allow entity-expansion attacks."""

import math
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes

Element = ElementTree.Element
MAX_DEPTH = 100
"""Levels of elements; the formats that are read have about ten."""


class _DoctypeRefuser(ElementTree.TreeBuilder):
    def doctype(self, name: str, *_: str | None) -> NoReturn:
        raise InputError(f"expected XML without a document type, found <!DOCTYPE {name}>")


def _check_depth(root: Element) -> None:
    """Raise InputError for elements nested so deeply that code which calls itself for each would fail."""
    level = [root]
    for _ in range(MAX_DEPTH):
        level = [child for element in level for child in element]
        if not level:
            return
    raise InputError(f"expected elements at most {MAX_DEPTH} deep, found more")


def read_xml(path: Path) -> Element:
    """Return the root element of an XML file; raise InputError if it is unreadable, malformed or has a DOCTYPE."""
    try:
        return parse_xml(path, read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def parse_xml(path: Path, data: bytes) -> Element:
    """Return the root element of XML in memory, as `read_xml` does; `path` is the file that errors name."""
    try:
        root = ElementTree.fromstring(data, ElementTree.XMLParser(target=_DoctypeRefuser()))
        _check_depth(root)
        return root
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the last two: encodings that Python lacks
        raise InputError(f"{path}: expected well-formed XML, found: {error}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def strip_namespaces(root: Element) -> bool:
    """Remove the namespaces of all elements, in place; return whether there were any."""
    named = [element for element in root.iter() if element.tag.startswith("{")]
    for element in named:
        element.tag = element.tag.partition("}")[2]
    return bool(named)


def read_number(path: Path, element: Element, name: str) -> float:
    """Return an attribute as a finite number; raise InputError."""
    return parse_finite(f"{path}: {element.tag}: {name}", element.get(name))


def parse_finite(where: str, text: str | None) -> float:
    """Parse a finite number; raise InputError."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: expected a finite number, found {text!r}")
    return value

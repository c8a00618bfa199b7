"""Untrusted XML: document types are refused because they allow entity-expansion attacks."""

import math
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError

Element = ElementTree.Element


class _DoctypeRefuser(ElementTree.TreeBuilder):
    def doctype(self, name: str, *_: str | None) -> NoReturn:
        raise InputError(f"expected XML without a document type, found <!DOCTYPE {name}>")


def read_xml(path: Path) -> Element:
    """Return the root element of an XML file; raise InputError if it is unreadable, malformed or has a DOCTYPE."""
    try:
        return ElementTree.fromstring(path.read_bytes(), ElementTree.XMLParser(target=_DoctypeRefuser()))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: expected well-formed XML, found: {error}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


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

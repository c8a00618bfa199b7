"""The committed bundle of three.js is the one that the tool states, with its licence."""

import hashlib
import re

from tools.bundle_three import BUNDLE, BUNDLE_SHA256, LICENCE, STATIC, list_names


def test_the_bundle_is_the_stated_one() -> None:
    assert hashlib.sha256((STATIC / BUNDLE).read_bytes()).hexdigest() == BUNDLE_SHA256


def test_the_licence_is_beside_it() -> None:
    assert "The MIT License" in (STATIC / LICENCE).read_text("utf-8")


def test_the_view_takes_what_is_bundled_and_no_more_is_bundled() -> None:
    bundled = re.findall(r"\b([A-Z]\w+):\(\)=>", (STATIC / BUNDLE).read_text("utf-8"))
    assert sorted(bundled) == list_names()

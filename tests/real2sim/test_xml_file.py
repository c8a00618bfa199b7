"""XML of strangers: encodings, depth and document types."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.xml_file import MAX_DEPTH, read_xml

BAD = {
    "unknown encoding": (b"<?xml version='1.0' encoding='klingon'?><a/>", "expected well-formed XML, found: unknown"),
    "encoding of many bytes": (b"<?xml version='1.0' encoding='utf-7'?><a/>", "expected well-formed XML, found: "),
    "encoding that is none": (b"<?xml version='1.0' encoding='zip'?><a/>", "expected well-formed XML, found: "),
    "wrong bytes": (b"<?xml version='1.0' encoding='utf-16'?><a/>", "expected well-formed XML, found: "),
    "no text": (b"\xff\xfe\x00", "expected well-formed XML, found: "),
    "deep": (b"<a>" * 100_000 + b"</a>" * 100_000, f"expected elements at most {MAX_DEPTH} deep, found more"),
    "entities": (b"<!DOCTYPE a [<!ENTITY b 'bb'>]><a>&b;</a>", "expected XML without a document type, found <!DOCTYPE"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_bad_xml_is_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    path = tmp_path / "map.osm"
    path.write_bytes(BAD[name][0])
    for read in (read_xml, read_lanelet2):
        with pytest.raises(InputError, match=BAD[name][1]) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1", "cp1252", "koi8-r"])
def test_encodings_that_python_knows_are_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "map.xml"
    word = "д" if encoding == "koi8-r" else "ä"
    path.write_bytes(f"<?xml version='1.0' encoding='{encoding}'?><a b='{word}'>{'<c/>' * 3}</a>".encode(encoding))
    assert read_xml(path).get("b") == word

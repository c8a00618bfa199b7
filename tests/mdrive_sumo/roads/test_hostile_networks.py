"""Network folders of strangers: one sentence for nets that are damaged, incomplete or too large."""

import gzip
import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, load_road_map, road_map
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum

SOURCE = find_network_folder("city_crossing")
NET = gzip.decompress((SOURCE / NET_FILE).read_bytes())


def write(folder: Path, xml: bytes, packed: bytes | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    about = json.loads((SOURCE / NETWORK_FILE).read_text())
    (folder / NETWORK_FILE).write_text(json.dumps(about | {"checksum": compute_net_checksum(xml)}))
    (folder / NET_FILE).write_bytes(gzip.compress(xml, 1) if packed is None else packed)
    return folder


BAD = {
    "no XML": (b"edge,lane", "expected a SUMO network, found .*(Parse|Syntax)"),
    "cut off": (NET[: len(NET) // 2], "expected a SUMO network, found .*(Parse|Syntax)"),
    "unknown encoding": (NET.replace(b"UTF-8", b"KLINGON", 1), "expected a SUMO network, found .*(Parse|Syntax)"),
    "entities": (
        b"<!DOCTYPE net [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><net>&a;</net>",
        "expected a SUMO network without a document type",
    ),
    "no lane length": (NET.replace(b" shape=", b" form="), "expected a SUMO network, found "),
    "no numbers": (NET.replace(b' speed="', b' speed="x'), "expected a SUMO network, found ValueError: "),
    "no junctions": (NET.replace(b"<junction ", b"<crossroad ").replace(b"</junction>", b"</crossroad>"), "expected "),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_nets_are_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    folder = write(tmp_path / "net", BAD[name][0])
    with pytest.raises(InputError, match=BAD[name][1]) as caught:
        load_road_map(folder)
    assert str(caught.value).startswith(f"{folder / NET_FILE}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("packed", [b"", b"PK\3\4", gzip.compress(NET)[:-3000], gzip.compress(NET)[:40] + b"\xff" * 99])
def test_damaged_packing_is_refused_in_a_sentence(packed: bytes, tmp_path: Path) -> None:
    folder = write(tmp_path / "net", NET, packed)
    with pytest.raises(InputError, match=r"map\.net\.xml\.gz: (cannot be read as a gzipped|expected the checksum)"):
        load_road_map(folder)


def test_a_net_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(road_map, "MAX_NET_BYTES", 1_000_000)
    folder = write(tmp_path / "net", b" " * 1_000_001)
    with pytest.raises(InputError, match=r"map\.net\.xml\.gz: expected a SUMO network of at most 1000000 bytes, found"):
        load_road_map(folder)
    shutil.rmtree(folder)


@given(damage=st.lists(st.tuples(st.integers(0, len(NET)), st.binary(min_size=1, max_size=4)), min_size=1, max_size=3))
@settings(max_examples=15)
def test_changed_bytes_are_read_or_refused(
    damage: list[tuple[int, bytes]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    xml = NET
    for place, part in damage:
        xml = xml[:place] + part + xml[place + len(part) :]
    folder = write(tmp_path_factory.mktemp("net"), xml)
    try:
        load_road_map(folder)
    except InputError as error:
        assert "\n" not in str(error)

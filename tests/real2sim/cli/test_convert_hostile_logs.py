"""`mdrive-sumo convert` on files that are made to crash it: one sentence, exit code 2, nothing left behind."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pyarrow import feather
from testing import argoverse2_samples
from testing.commonroad_samples import CAR, LANE, format_scenario
from testing.convert_command import refused
from testing.interaction_samples import build_street, write_table

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_workers")]


def objects_at_addresses(folder: Path) -> tuple[str, Path]:
    """numpy.ndarray((1,), "O", bytes): the bytes are taken for the address of an object."""
    path = folder / "log.pkl"
    path.write_bytes(b"\x80\x04cnumpy\nndarray\n(K\x01\x85\x8c\x01OC\x08\x00\x00AAAA\x00\x00tR.")
    return "scenarionet", path


def wild_offsets(folder: Path) -> tuple[str, Path]:
    """Offsets of the text in a column point out of the table, which makes pyarrow crash."""
    log = argoverse2_samples.log(folder / "log")
    path = log / "annotations.feather"
    feather.write_feather(feather.read_table(path), path, compression="uncompressed")
    whole = bytearray(path.read_bytes())
    offsets = b"".join(
        (3 * n).to_bytes(4, "little") for n in range(1, argoverse2_samples.SWEEPS)
    )  # of "car", "car", ...
    at = whole.index(offsets)
    whole[at + 3] = whole[at + 7] = 0x7F
    path.write_bytes(whole)
    return "argoverse2", log


def centuries(folder: Path) -> tuple[str, Path]:
    build_street().write(folder / "map.osm")
    rows = ("1,1,100,car,1,2,10,0,0,4,2", "1,2,12884901900000,car,1,2,10,0,0,4,2")
    return "interaction", write_table(folder / "vehicle_tracks_000.csv", *rows)


def unknown_encoding(folder: Path) -> tuple[str, Path]:
    path = folder / "scenario.xml"
    path.write_text(f"<?xml version='1.0' encoding='klingon'?>{format_scenario(LANE, CAR)}")
    return "commonroad", path


ATTACKS: dict[Callable[[Path], tuple[str, Path]], str] = {
    objects_at_addresses: "log.pkl: expected a complete pickle, found: ValueError expected arrays as numpy writes them",
    wild_offsets: "annotations.feather: expected a complete feather table, found: ",
    centuries: "vehicle_tracks_000.csv: timestamp_ms: expected times within 36000 frames, found 1.28849e+11",
    unknown_encoding: "scenario.xml: expected well-formed XML, found: unknown encoding",
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_hostile_log_costs_a_sentence(attack: Callable[[Path], tuple[str, Path]], tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    source, path = attack(tmp_path)
    assert ATTACKS[attack] in refused(tmp_path, source, path)

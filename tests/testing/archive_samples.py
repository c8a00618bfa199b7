"""Archives, good and bad, made by hand where zipfile would not make them. No tests in here."""

import random
import stat
import struct
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

AGENT = b"class Agent:\n    pass\n"
ENV = b"environment: python3.11-numpy\n"
GOOD: dict[str, bytes] = {"agents.py": AGENT, "model_env.yaml": ENV}
DECLARING_AGENT = """
import os
from mdrive_sumo.contract import STANDSTILL, Reply, SensorSpec

class Agent:
    label = "{label}"
    def __init__(self, config):
        {made}
    def sensors(self):
        return ({sensors})
    def start(self, briefing): pass
    def act(self, seen):
        return Reply(control=STANDSTILL)
"""
Info = zipfile.ZipInfo


def packed(files: Mapping[str, bytes], more: Callable[[zipfile.ZipFile], None] | None = None) -> bytes:
    """A zip of these files, and what `more` adds: the same bytes at any time, for entries have no date of today."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            info = Info(name)
            info.external_attr = 0o40775 << 16 | 0x10 if name.endswith("/") else 0o600 << 16
            archive.writestr(info, data, zipfile.ZIP_DEFLATED)
        if more is not None:
            more(archive)
    return file.getvalue()


def declaring(sensors: str = "", label: str = "single", made: str = "pass") -> str:
    """The source of an agent with these sensors; it stands still. made: what its constructor does."""
    return DECLARING_AGENT.format(sensors=sensors, label=label, made=made)


def with_entry(name: str, data: bytes = b"x", mode: int = stat.S_IFREG | 0o644) -> bytes:
    """The good archive and one more entry."""

    def add(archive: zipfile.ZipFile) -> None:
        info = Info(name)
        info.external_attr = mode << 16
        info.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(info, data)

    return packed(GOOD, add)


def twice(name: str) -> bytes:
    """The good archive, and two entries of one name (zipfile warns of that)."""
    return with_entry("x" * len(name)).replace(b"x" * len(name), name.encode())


def patched(data: bytes, name: str, field: int, code: str, value: int, local: int | None = None) -> bytes:
    """Overwrites a field of an entry's record in the directory and, if it is there too, of its local header.

    Fields of the directory (offset, code): flags (8, H), method (10, H), CRC (16, I), packed size (20, I),
    size (24, I), header offset (42, I).
    """
    changed = bytearray(data)
    at = changed.rfind(b"PK\1\2", 0, changed.rfind(name.encode()))
    struct.pack_into(f"<{code}", changed, at + field, value)
    if local is not None:
        (header,) = struct.unpack_from("<I", changed, at + 42)
        struct.pack_into(f"<{code}", changed, header + local, value)
    return bytes(changed)


def many(count: int) -> bytes:
    """The good archive and so many empty files."""
    return packed(GOOD | {f"src/{number}": b"" for number in range(count)})


def written(folder: Path, data: bytes) -> Path:
    """As a file."""
    path = folder / "team.zip"
    path.write_bytes(data)
    return path


def broken_at_its_end(size: int, blocks: int = 25) -> bytes:
    """The good archive and a file of so many MiB that packs about 20 times; its checksum is wrong."""
    noise = random.Random(1)
    data = b"".join(noise.randbytes(1000) * blocks for _ in range(size * 2**20 // (1000 * blocks)))
    packed_file = with_entry("weights/x", data)
    return patched(packed_file, "weights/x", 16, "I", 0x12345678, 14)

"""Archives at random: accepted are those that a slow, plain oracle accepts, and damaged ones never do harm."""

import shutil
import stat
import tempfile
import warnings
import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from testing.archive_samples import GOOD, packed, written
from testing.sampling import examples

from server.archive import ArchiveLimits, ArchiveRefused, check_archive, extract_archive

LIMITS = ArchiveLimits(archive_bytes=2**20, unpacked_bytes=3000, entries=12)
PARTS = st.sampled_from(
    ["a", "A", "b", "c.py", "..", ".", "", "src", "\u00e9", "e\u0301", "x:y", "p\\q", "\t", "z" * 90]
)
NAMES = st.lists(PARTS, min_size=1, max_size=4).map("/".join)
MODES = st.sampled_from([0, stat.S_IFREG | 0o755, stat.S_IFREG | 0o755, stat.S_IFLNK | 0o777, stat.S_IFIFO])
ENTRIES = st.lists(st.tuples(NAMES, MODES, st.binary(max_size=1500)), max_size=5)
CALM = st.lists(
    st.tuples(st.lists(st.sampled_from("abc"), min_size=1, max_size=3).map("/".join), st.just(0), st.binary(max_size=9))
)
Entry = tuple[str, int, bytes]


def zipped(entries: Sequence[Entry]) -> bytes:
    """The good files and these."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of duplicates
        for name, data in GOOD.items():
            archive.writestr(name, data)
        for name, mode, data in entries:
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            archive.writestr(info, b"" if name.endswith("/") else data)
    return file.getvalue()


def acceptable(entries: Sequence[Entry]) -> bool:
    """What the rules say, pair by pair."""
    names = [*GOOD, *(name for name, _, _ in entries)]
    paths = {name: name.removesuffix("/") for name in names}
    if any(mode not in (0, stat.S_IFREG | 0o755) for _, mode, _ in entries):
        return False
    if any(name.endswith("/") and mode for name, mode, _ in entries):
        return False  # a file named as a folder
    for name in names:
        parts = paths[name].split("/")
        if any(part in ("", ".", "..") or set(part) & set("\\:\t") for part in parts) or len(name.encode()) > 200:
            return False
    if len({paths[name] for name in names}) < len(names):
        return False
    every = {"/".join(path.split("/")[: n + 1]) for path in paths.values() for n in range(path.count("/") + 1)}
    if len({part.replace("e\u0301", "\u00e9").lower() for part in every}) < len(every):
        return False
    files = {paths[name] for name in names if not name.endswith("/")}
    if any(other.startswith(f"{file}/") for file in files for other in every):
        return False
    size = sum(map(len, GOOD.values())) + sum(len(data) for name, _, data in entries if not name.endswith("/"))
    return len(every) <= LIMITS.entries and size <= LIMITS.unpacked_bytes


def outcome(data: bytes) -> dict[str, bytes] | None:
    """The unpacked files; None if it is refused. Nothing else may happen, and nothing outside the folder."""
    with tempfile.TemporaryDirectory() as made:
        folder, home = Path(made), Path(made) / "home" / "agent"
        home.parent.mkdir()
        path = written(folder, data)
        try:
            extract_archive(path, check_archive(path, LIMITS), home)
        except ArchiveRefused as refused:
            assert str(refused).isprintable()
            assert not home.exists()
            return None
        finally:
            assert {entry.name for entry in folder.iterdir()} == {"home", "team.zip"}
            assert {entry.name for entry in home.parent.iterdir()} <= {"agent"}
        assert all(not entry.is_symlink() for entry in home.rglob("*"))
        found = {str(file.relative_to(home)): file.read_bytes() for file in home.rglob("*") if file.is_file()}
        shutil.rmtree(home)
        return found


@settings(max_examples=examples(37, 150), deadline=None)
@given(st.one_of(ENTRIES, CALM))
def test_accepted_is_what_the_rules_accept(entries: list[Entry]) -> None:
    expected = dict(GOOD) | {name: data for name, _, data in entries if not name.endswith("/")}
    assert outcome(zipped(entries)) == (expected if acceptable(entries) else None)


@settings(max_examples=examples(37, 150), deadline=None)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=6), st.data())
def test_damaged_archives_are_refused_or_unpacked_and_nothing_else(
    changes: list[tuple[int, int]], data: st.DataObject
) -> None:
    damaged = bytearray(packed(dict(GOOD) | {"src/a.py": bytes(range(200)) * 4}))
    for where, value in changes:
        damaged[where % len(damaged)] = value
    cut = data.draw(st.integers(0, 30)) if data.draw(st.booleans()) else 0
    found = outcome(bytes(damaged[cut:]))
    assert found is None or sum(map(len, found.values())) <= LIMITS.unpacked_bytes

"""Archives: what is accepted is unpacked as it is, everything else is refused with one sentence."""

import os
import stat
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import pytest
from testing.archive_samples import AGENT, ENV, GOOD, many, packed, patched, twice, with_entry, written

from server.archive import ArchiveLimits, ArchiveRefused, Manifest, check_archive, extract_archive
from server.enums import ChallengeTrack

LIMITS = ArchiveLimits(archive_bytes=2**21, unpacked_bytes=2**23, entries=50, ratio=100)
JOINT = b'def get_entry_point():\n    return "Mine"\n'


def check(folder: Path, data: bytes, limits: ArchiveLimits = LIMITS) -> Manifest:
    return check_archive(written(folder, data), limits)


def unpacked(folder: Path, data: bytes) -> dict[str, bytes]:
    """Checked and unpacked: files by path."""
    path = written(folder, data)
    target = folder / "agent"
    extract_archive(path, check_archive(path, LIMITS), target)
    return {str(file.relative_to(target)): file.read_bytes() for file in target.rglob("*") if file.is_file()}


def linked(archive: zipfile.ZipFile) -> None:
    info = zipfile.ZipInfo("src/x")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    archive.writestr(info, "/etc")


ZEROS = bytes(2**20 + 1)
NOISE = os.urandom(3000)
HALF = zlib.crc32(NOISE[:1000])
BAD: Mapping[str, tuple[bytes, str]] = {
    "traversal": (with_entry("src/../../x"), "relative path"),
    "traversal at the start": (with_entry("../x"), "relative path"),
    "absolute": (with_entry("/etc/x"), "relative path"),
    "backslash": (with_entry("src\\x"), r"separated by '/', found '\\\\'"),
    "drive": (with_entry("C:x"), "found ':'"),
    "stream": (with_entry("src/x:y"), "found ':'"),
    "no name": (with_entry("src/x").replace(b"src/x", b"\0rc/x"), "relative path"),
    "empty part": (with_entry("src//x"), "relative path"),
    "dot part": (with_entry("./x"), "relative path"),
    "line break in a name": (with_entry("src/a\nb"), "printable"),
    "terminal code in a name": (with_entry("src/a\x1b[31m"), "printable"),
    "long name": (with_entry("src/" + "x" * 200), "at most 200 bytes"),
    "long name in few characters": (with_entry("src/" + "ü" * 150), "at most 200 bytes"),
    "link": (with_entry("src/x", b"/etc/passwd", stat.S_IFLNK | 0o777), "found a symbolic link"),
    "link out of weights": (with_entry("weights/x", b"../../../x", stat.S_IFLNK | 0o777), "found a symbolic link"),
    "link to a folder": (with_entry("src/x/", b"", stat.S_IFLNK | 0o777), "found a symbolic link"),
    "link and a file below": (
        packed(GOOD, lambda archive: (linked(archive), archive.writestr("src/x/y", b""))),
        "found a symbolic link",
    ),
    "device": (with_entry("x", b"", stat.S_IFCHR | 0o666), "found a device"),
    "block device": (with_entry("x", b"", stat.S_IFBLK | 0o666), "found a device"),
    "pipe": (with_entry("x", b"", stat.S_IFIFO | 0o666), "found a pipe"),
    "socket": (with_entry("x", b"", stat.S_IFSOCK | 0o666), "found a socket"),
    "folder that is a file": (with_entry("x/", b"", stat.S_IFREG | 0o666), "found a file named as a folder"),
    "folder with data": (with_entry("x/", b"data", stat.S_IFDIR | 0o755), "folder without data"),
    "case": (packed(GOOD | {"Agents.PY": b""}), "more than case"),
    "case of a folder": (packed(GOOD | {"src/a": b"", "SRC/b": b""}), "more than case"),
    "case in two encodings": (packed(GOOD | {"src/\u00e9": b"", "src/e\u0301": b""}), "more than case"),
    "duplicate": (twice("agents.py"), "'agents.py' again"),
    "file and folder": (packed(GOOD | {"src": b"", "src/a": b""}), "found both"),
    "folder and file": (packed(GOOD | {"src/a": b"", "src": b""}), "found both"),
    "file and folder of one name": (packed(GOOD | {"src": b"", "src/": b""}), "'src' again"),
    "too many entries": (many(60), "at most 50 entries, found 62"),
    "too many folders": (with_entry("/".join("abcdefghijklmnopqrstuvwxyz" * 2)), "at most 50 files and folders"),
    "a directory that is too long": (many(3000), "directory that is too long"),
    "bomb": (with_entry("weights/x", ZEROS * 2), "at most 100 times"),
    "bomb of many": (packed(GOOD | {f"src/{n}": bytes(2**20) for n in range(9)}), "at most 8388608 bytes unpacked"),
    "declared too small": (patched(with_entry("x", NOISE), "x", 24, "I", 1000, 22), "its size declared"),
    "declared a little too small": (patched(with_entry("x", NOISE), "x", 24, "I", 2999, 22), "Bad CRC-32"),
    "declared too large": (
        patched(with_entry("x", NOISE), "x", 24, "I", 3001, 22),
        "3001 bytes as declared, found 3000",
    ),
    "bomb declared small": (patched(with_entry("x", ZEROS * 9), "x", 24, "I", 1000, 22), "its size declared"),
    "wrong checksum": (patched(with_entry("x", NOISE), "x", 16, "I", HALF, 14), "Bad CRC-32"),
    "damaged data": (
        with_entry("x", NOISE * 9)[:200] + bytes(40) + with_entry("x", NOISE * 9)[240:],
        "damaged|Bad CRC",
    ),
    "encrypted": (patched(with_entry("x"), "x", 8, "H", 1, 6), "no encryption"),
    "headers encrypted": (patched(with_entry("x"), "x", 8, "H", 0x2000, 6), "no encryption"),
    "method": (patched(with_entry("x"), "x", 10, "H", 12, 8), "stored or deflated data, found method 12"),
    "overlapping": (patched(with_entry("x", NOISE), "x", 42, "I", 0), "found shared data"),
    "data in the directory": (patched(with_entry("x", NOISE), "x", 20, "I", 3060), "its data in the file|shared data"),
    "header elsewhere": (patched(with_entry("x", NOISE), "x", 42, "I", 120), "shared data|its data in the file"),
    "truncated": (with_entry("x", NOISE)[:-200], "damaged one"),
    "truncated in the middle": (with_entry("x", NOISE)[:1000], "damaged one"),
    "beginning lost": (with_entry("x", NOISE)[500:], "damaged one|in the file|shared data"),
    "not a zip": (b"PK" + NOISE, "damaged one"),
    "text": (b"hello", "damaged one"),
    "0 bytes": (b"", "an empty file"),
    "empty zip": (packed({}), "an empty archive"),
    "too large": (bytes(2**21 + 1), "at most 2097152 bytes, found 2097153 bytes"),
    "folders only": (packed({"src/": b""}), "expected agents.py at the top .* found none"),
    "two folders deep": (packed({f"a/b/{name}": data for name, data in GOOD.items()}), "found a/b/agents.py"),
    "two folders": (packed({f"a/{name}": data for name, data in GOOD.items()} | {"b/x": b""}), "found a/agents.py"),
    "folder and file at the top": (packed({f"a/{n}": d for n, d in GOOD.items()} | {"b": b""}), "found a/agents.py"),
    "agents.py is a folder": (packed({"agents.py/": b"", "model_env.yaml": ENV}), "expected agents.py at the top"),
    "no model_env.yaml": (packed({"agents.py": AGENT}), "expected model_env.yaml of at most 65536 bytes, found none"),
    "model_env.yaml elsewhere": (packed({"agents.py": AGENT, "src/model_env.yaml": ENV}), "model_env.yaml"),
    "no agent": (packed(GOOD | {"agents.py": b"x = 1\n"}), "class Agent or a function get_entry_point"),
    "agent in a function": (packed(GOOD | {"agents.py": b"def f():\n    class Agent: ...\n"}), "class Agent"),
    "huge agents.py": (
        packed(GOOD | {"agents.py": os.urandom(600_000).hex().encode()}),
        "agents.py of at most 1048576 bytes",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_archives_are_refused_with_one_sentence(case: str, tmp_path: Path) -> None:
    data, expected = BAD[case]
    with pytest.raises(ArchiveRefused, match=expected) as refused:
        check(tmp_path, data)
    assert "\n" not in str(refused.value)
    assert str(refused.value).isprintable()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("environment: python2.7", "one of python3.11-numpy, python3.11-onnx, python3.11-torch-cpu, found 'python2.7'"),
        ("name: colmdriver", "one of python3.11-numpy, python3.11-onnx, python3.11-torch-cpu, found 'colmdriver'"),
        ("environment: 3.11", "found '3.11'"),
        ("{}", "expected a line `environment: python3.11-numpy"),
        ("", "expected a line `environment: python3.11-numpy"),
        ("environment:", "expected a line `environment: python3.11-numpy"),
        ("  environment: python3.11-numpy", "expected a line"),
        ("[" * 65_000, "expected a line"),
        ("environment: " + "\x1b" * 9, "found '.x1b"),
        ("environment: python3.11-numpy\npython: '3.8'", "python: expected 3.11, .* found '3.8'"),
        ("name: python3.11-numpy\ndependencies:\n  - python=3.8.18", "python: expected 3.11, .* found '3.8'"),
        ("environment: python3.11-numpy\nconfig: config/x", "file of the archive, found 'config/x'"),
        ("environment: python3.11-numpy\nconfig: ../x", "file of the archive, found '../x'"),
    ],
)
def test_bad_environments_are_refused_with_one_sentence(text: str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(ArchiveRefused, match=expected) as refused:
        check(tmp_path, packed(GOOD | {"model_env.yaml": text.encode()}))
    assert "model_env.yaml" in str(refused.value)
    assert str(refused.value).isprintable()


def test_a_good_archive_is_unpacked_as_it_is(tmp_path: Path) -> None:
    files = dict(GOOD) | {"src/a/b.py": b"b", "weights/x.bin": NOISE, "config/submission_config.yaml": b"c"}
    assert unpacked(tmp_path, packed(files | {"src/empty/": b""})) == files
    manifest = check_archive(tmp_path / "team.zip", LIMITS)
    assert (manifest.style, manifest.entry) == ("agent", "/agent/agents.py:Agent")
    assert manifest.agent_config() == {"config": "/agent/config/submission_config.yaml"}
    assert (manifest.files, manifest.bytes) == (5, sum(map(len, files.values())))
    assert (manifest.environment, manifest.track_hint) == ("python3.11-numpy", None)


@pytest.mark.parametrize("mode", [0o4755, 0o6777, 0o000])
def test_modes_are_ours(mode: int, tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        unpacked(tmp_path, with_entry("src/run", b"x", stat.S_IFREG | mode))
    finally:
        os.umask(before)
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "agent").rglob("*")}
    assert modes == {"agents.py": 0o644, "model_env.yaml": 0o644, "src": 0o755, "run": 0o644}
    assert stat.S_IMODE((tmp_path / "agent").stat().st_mode) == 0o755


def test_a_zip_in_the_zip_stays_data(tmp_path: Path) -> None:
    inner = packed({"../../x": b"x"})
    assert unpacked(tmp_path, with_entry("weights/inner.zip", inner))["weights/inner.zip"] == inner


def test_a_name_ends_at_nul(tmp_path: Path) -> None:
    data = with_entry("src/a.py_b").replace(b"src/a.py_b", b"src/a.py\0b")
    assert "src/a.py" in unpacked(tmp_path, data)


def test_a_single_folder_and_what_a_mac_adds_are_stripped(tmp_path: Path) -> None:
    files = {f"team-main/{name}": data for name, data in GOOD.items()}
    litter = {"__MACOSX/team-main/._agents.py": b"x", "team-main/src/.DS_Store": b"x"}
    assert unpacked(tmp_path, packed({"team-main/": b""} | files | litter)) == GOOD


@pytest.mark.parametrize(
    ("source", "style"),
    [
        (b"class Agent(Base):\n    pass\n", "agent"),
        (b"from src.mine import Mine as Agent\n", "agent"),
        (b"from src.mine import (\n    Agent,\n)\n", "agent"),
        (b"Agent = object\n", "agent"),
        (JOINT, "joint"),
        (b"from src.mine import get_entry_point\n", "joint"),
        (b"class Agent: ...\n" + JOINT, "joint"),
        ("# \u00e9\n".encode("latin-1") + b"class Agent: ...\r\n", "agent"),
    ],
)
def test_style_is_read_and_not_run(source: bytes, style: str, tmp_path: Path) -> None:
    manifest = check(tmp_path, packed(GOOD | {"agents.py": b"raise SystemExit\n" + source}))
    assert manifest.style == style


def test_a_joint_agent_has_its_own_track_and_is_told_a_file(tmp_path: Path) -> None:
    files = GOOD | {"agents.py": JOINT, "config/mine.yaml": b"", "Dockerfile": b"RUN rm -rf /\n"}
    manifest = check(tmp_path, packed(files))
    assert (manifest.entry, manifest.track_hint) == ("carla:/agent/agents.py", ChallengeTrack.JOINT)
    assert manifest.locator("/tmp/x") == "carla:/tmp/x/agents.py"
    assert manifest.agent_config("/tmp/x") == {"config": "/tmp/x/config/mine.yaml"}
    assert manifest.dockerfile


def test_which_file_an_agent_is_told(tmp_path: Path) -> None:
    two = dict(GOOD) | {"config/a.yaml": b"", "config/b.yaml": b""}
    assert check(tmp_path, packed(GOOD)).config is None
    assert check(tmp_path, packed(two)).config is None
    asked = two | {"model_env.yaml": ENV + b"config: config/b.yaml\n"}
    assert check(tmp_path, packed(asked)).config == "config/b.yaml"


def test_conda_files_are_taken_by_their_name(tmp_path: Path) -> None:
    conda = b"name: 'python3.11-numpy' # ours\r\nchannels: [x]\ndependencies:\n- python=3.11.9\n- pip: [numpy]\n"
    assert check(tmp_path, packed(GOOD | {"model_env.yaml": conda})).environment == "python3.11-numpy"


def test_limits_are_settings(tmp_path: Path) -> None:
    bomb = with_entry("weights/x", ZEROS)
    with pytest.raises(ArchiveRefused, match="100 times"):
        check(tmp_path, bomb)
    assert check(tmp_path, bomb, ArchiveLimits(ratio=10_000)).bytes > len(ZEROS)


def test_only_the_checked_archive_is_unpacked_and_nothing_stays_of_a_failure(tmp_path: Path) -> None:
    path = written(tmp_path, with_entry("x", NOISE))
    manifest = check_archive(path, LIMITS)
    written(tmp_path, with_entry("y", NOISE))
    with pytest.raises(ArchiveRefused, match="the one that was checked"):
        extract_archive(path, manifest, tmp_path / "agent")
    (tmp_path / "taken").mkdir()
    with pytest.raises(FileExistsError):
        extract_archive(written(tmp_path, with_entry("x", NOISE)), manifest, tmp_path / "taken")
    assert not (tmp_path / "agent").exists()
    assert (tmp_path / "taken").exists()

"""The contents of an archive, found without running any of it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from server.archive import layout, model_env
from server.archive.layout import ArchiveLimits, ArchiveRefused
from server.archive.zip_reader import open_archive, read_entry
from server.enums import ChallengeTrack

BOX_FOLDER = "/agent"
"""Folder at which a sandbox sees the unpacked archive."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """Description of an archive in plain values, which can be serialised."""

    style: layout.Style
    config: str | None
    """Relative path of the agent's configuration file, if any."""
    environment: str
    track_hint: ChallengeTrack | None
    """Joint for joint agents; None if it depends on the agent's messages."""
    dockerfile: bool
    """Whether there is a Dockerfile, which is not built."""
    files: int
    bytes: int
    """Total size of the unpacked files [bytes]."""
    sha256: str
    """SHA-256 of the archive, in hexadecimal."""
    root: str
    """Folder of the archive that contains everything, with its slash; "" for none."""

    @property
    def entry(self) -> str:
        """Name of the agent inside a sandbox, in the form of `--agent`."""
        return self.locator(BOX_FOLDER)

    def locator(self, folder: str) -> str:
        """Return the name of the agent if the archive is unpacked in `folder`."""
        file = f"{folder}/{layout.AGENTS}"
        return f"carla:{file}" if self.style == "joint" else f"{file}:Agent"

    def agent_config(self, folder: str = BOX_FOLDER) -> dict[str, str]:
        """Return the agent's options: `config` is the path of its configuration file."""
        return {} if self.config is None else {"config": f"{folder}/{self.config}"}


def check_archive(path: Path, limits: ArchiveLimits) -> Manifest:
    """Check an archive including every byte of its contents. Raises ArchiveRefused, one sentence."""
    manifest = inspect_archive(path, limits)
    verify_contents(path, limits)
    return manifest


def inspect_archive(path: Path, limits: ArchiveLimits) -> Manifest:
    """Check the directory, `model_env.yaml` and `agents.py` of an archive: takes milliseconds whatever its size.

    Raises ArchiveRefused.
    """
    with open_archive(path, limits) as archive:
        infos = {info.filename: info for info in archive.infolist() if not layout.is_mac_metadata(info.filename)}
        root = layout.find_root(tuple(infos))
        files = {name.removeprefix(root): info for name, info in infos.items() if not info.is_dir()}
        environment = model_env.parse_model_env(_read(archive, files, model_env.FILE, model_env.MAX_BYTES))
        text = _read(archive, files, layout.AGENTS, layout.MAX_AGENTS_BYTES).decode("utf-8", errors="replace")
        style = layout.find_style(text)
        config = layout.find_config(tuple(files), environment.config)
    return Manifest(
        style=style,
        config=config,
        environment=environment.environment,
        track_hint=ChallengeTrack.JOINT if style == "joint" else None,
        dockerfile="Dockerfile" in files,
        files=len(files),
        bytes=sum(info.file_size for info in files.values()),
        sha256=compute_sha256(path),
        root=root,
    )


def verify_contents(path: Path, limits: ArchiveLimits) -> None:
    """Read every byte of an archive's contents: sizes and checksums are as declared. Raises ArchiveRefused.

    It reads at most `limits.total_ratio` times the archive's size, up to `limits.unpacked_bytes`.
    """
    with open_archive(path, limits) as archive:
        for info in archive.infolist():
            if not layout.is_mac_metadata(info.filename):
                for _ in read_entry(archive, info):
                    pass


def compute_sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read(archive: ZipFile, files: dict[str, ZipInfo], name: str, max_bytes: int) -> bytes:
    info = files.get(name)
    if info is None or info.file_size > max_bytes:
        size = "none" if info is None else f"{info.file_size} bytes"
        raise ArchiveRefused(f"archive: expected {name} of at most {max_bytes} bytes, found {size}")
    return b"".join(read_entry(archive, info))

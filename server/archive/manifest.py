"""What an archive holds, known without running any of it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from server.archive import layout, model_env
from server.archive.errors import ArchiveRefused
from server.archive.limits import ArchiveLimits
from server.archive.zip_reader import open_archive, read_entry
from server.enums import ChallengeTrack

BOX_FOLDER = "/agent"
"""Where a box sees the unpacked archive."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """Plain values, so that they can be kept with a submission."""

    style: layout.Style
    config: str | None
    """The file that the agent is told, relative; None for none."""
    environment: str
    track_hint: ChallengeTrack | None
    """Joint agents have a track of their own; None where it depends on what the agent does."""
    dockerfile: bool
    """There is one; it is not built."""
    files: int
    bytes: int
    """Unpacked."""
    sha256: str
    """Of the archive."""
    root: str
    """Folder of the archive that everything is in, with its slash; "" for none."""

    @property
    def entry(self) -> str:
        """The agent in a box, as `--agent` and `Job.agent` name it."""
        return self.locator(BOX_FOLDER)

    def locator(self, folder: str) -> str:
        """The same where the archive is unpacked in `folder`."""
        file = f"{folder}/{layout.AGENTS}"
        return f"carla:{file}" if self.style == "joint" else f"{file}:Agent"

    def agent_config(self, folder: str = BOX_FOLDER) -> dict[str, str]:
        """The agent's options: `config` is the path of its file."""
        return {} if self.config is None else {"config": f"{folder}/{self.config}"}


def check_archive(path: Path, limits: ArchiveLimits) -> Manifest:
    """Checks an archive as a whole, each byte of it included. Raises ArchiveRefused, one sentence."""
    with open_archive(path, limits) as archive:
        infos = {info.filename: info for info in archive.infolist() if not layout.is_mac_metadata(info.filename)}
        root = layout.find_root(tuple(infos))
        files = {name.removeprefix(root): info for name, info in infos.items() if not info.is_dir()}
        wanted = model_env.parse_model_env(_read(archive, files, model_env.FILE, model_env.MAX_BYTES))
        text = _read(archive, files, layout.AGENTS, layout.MAX_AGENTS_BYTES).decode("utf-8", errors="replace")
        style = layout.find_style(text)
        config = layout.find_config(tuple(files), wanted.config)
        for info in infos.values():
            for _ in read_entry(archive, info):
                pass
    return Manifest(
        style=style,
        config=config,
        environment=wanted.environment,
        track_hint=ChallengeTrack.JOINT if style == "joint" else None,
        dockerfile="Dockerfile" in files,
        files=len(files),
        bytes=sum(info.file_size for info in files.values()),
        sha256=compute_sha256(path),
        root=root,
    )


def compute_sha256(path: Path) -> str:
    """Of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read(archive: ZipFile, files: dict[str, ZipInfo], name: str, most: int) -> bytes:
    info = files.get(name)
    if info is None or info.file_size > most:
        found = "none" if info is None else f"{info.file_size} bytes"
        raise ArchiveRefused(f"archive: expected {name} of at most {most} bytes, found {found}")
    return b"".join(read_entry(archive, info))

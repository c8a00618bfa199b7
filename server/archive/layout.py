"""Layout of an archive, and limits of its size. MDrive's own layout, or the same in one folder, as GitHub's archives.

agents.py         get_entry_point() of a joint agent in the style of the CARLA leaderboard, or a class Agent
model_env.yaml    the environment by name
config/ src/ weights/ Dockerfile    optional; the Dockerfile is recorded, not built
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from mdrive_sumo.core.errors import InputError
from server.environments import MEBIBYTE

FREE_BYTES = 8 * MEBIBYTE
"""Unpacked size up to which the ratio of a whole archive does not matter [bytes]."""


@dataclass(frozen=True, slots=True)
class ArchiveLimits:
    """Upper limits; the field names are those of `server.settings.ArchiveSettings`."""

    archive_bytes: int = 64 * MEBIBYTE
    """Size of the archive file [bytes]."""
    unpacked_bytes: int = 256 * MEBIBYTE
    """Total size of all unpacked files [bytes]."""
    entries: int = 2000
    """Number of files and folders, including folders that occur only as parts of paths."""
    ratio: int = 200
    """Unpacked size over packed size of each entry above 1 MiB."""
    total_ratio: int = 50
    """Total unpacked size over the size of the archive, above `FREE_BYTES`: bounds the work that an upload causes."""


class ArchiveRefused(InputError):
    """The archive or what its agent requires is refused; the sentence is for its team."""


AGENTS = "agents.py"
MAX_AGENTS_BYTES = MEBIBYTE
"""Size limit of `agents.py` [bytes]: it is searched for its definitions as a whole."""
CONFIG = "config/"
SUBMISSION_CONFIG = "config/submission_config.yaml"
"""Configuration file of MDrive's own agents."""
MAC_METADATA = ("__MACOSX/", ".DS_Store")
"""Metadata that macOS adds to archives, which is ignored."""
Style = Literal["agent", "joint"]

_DEFINITION = re.compile(r"^(?:def|class)[ \t]+(\w+)|^(\w+)[ \t]*[:=]", re.MULTILINE)
_IMPORT = re.compile(r"^from[ \t]+\S+[ \t]+import[ \t]+(?:\(([^)]{0,1000})\)|([^(\n]*))", re.MULTILINE)


def is_mac_metadata(name: str) -> bool:
    """Return whether an entry is metadata of macOS."""
    return name.startswith(MAC_METADATA[0]) or name.rpartition("/")[2] == MAC_METADATA[1]


def find_root(names: Sequence[str]) -> str:
    """Return the common prefix of all paths: "" or a folder with its slash. Raises ArchiveRefused."""
    if AGENTS in names:
        return ""
    tops = {name.partition("/")[0] for name in names}
    if len(tops) == 1 and (only := f"{tops.pop()}/") + AGENTS in names:
        return only
    elsewhere = next((name for name in names if name.endswith(f"/{AGENTS}")), "none")
    raise ArchiveRefused(f"archive: expected {AGENTS} at the top or in the only folder there, found {elsewhere:.80}")


def find_style(text: str) -> Style:
    """Return which style of agent a module defines, without running it. Raises ArchiveRefused."""
    names = {name for pair in _DEFINITION.findall(text) for name in pair}
    for listed in _IMPORT.findall(text):
        names.update(re.findall(r"\w+", " ".join(listed)))
    if "get_entry_point" in names:
        return "joint"
    if "Agent" in names:
        return "agent"
    raise ArchiveRefused(f"{AGENTS}: expected a class Agent or a function get_entry_point in it, found neither")


def find_config(files: Sequence[str], requested: str | None) -> str | None:
    """Return the agent's configuration file: the requested one, MDrive's, or the only one in config/.

    Raises ArchiveRefused if the requested one is missing.
    """
    if requested is not None:
        if requested not in files:
            raise ArchiveRefused(f"model_env.yaml: config: expected a file of the archive, found {requested!r:.80}")
        return requested
    configs = [name for name in files if name.startswith(CONFIG)]
    if SUBMISSION_CONFIG in configs:
        return SUBMISSION_CONFIG
    return configs[0] if len(configs) == 1 else None

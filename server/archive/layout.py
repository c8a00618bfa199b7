"""What must be where in an archive: MDrive's own layout, or that in a single folder, as GitHub packs it.

agents.py         get_entry_point() of a joint agent in the style of the CARLA leaderboard, or a class Agent
model_env.yaml    the environment by name
config/ src/ weights/ Dockerfile    optional; the Dockerfile is noted, never built
"""

import re
from collections.abc import Sequence
from typing import Literal

from server.archive.errors import ArchiveRefused

AGENTS = "agents.py"
MAX_AGENTS_BYTES = 1024 * 1024
CONFIG = "config/"
SUBMISSION_CONFIG = "config/submission_config.yaml"
"""What MDrive tells an agent."""
MAC_METADATA = ("__MACOSX/", ".DS_Store")
"""What a Mac adds to archives: passed over."""
Style = Literal["agent", "joint"]

_DEFINITION = re.compile(r"^(?:def|class)[ \t]+(\w+)|^(\w+)[ \t]*[:=]", re.MULTILINE)
_IMPORT = re.compile(r"^from[ \t]+\S+[ \t]+import[ \t]+(?:\(([^)]{0,1000})\)|([^(\n]*))", re.MULTILINE)


def is_mac_metadata(name: str) -> bool:
    """Whether nobody meant to send it."""
    return name.startswith(MAC_METADATA[0]) or name.rpartition("/")[2] == MAC_METADATA[1]


def find_root(names: Sequence[str]) -> str:
    """What every path begins with: "" or a folder with its slash. Raises ArchiveRefused."""
    if AGENTS in names:
        return ""
    tops = {name.partition("/")[0] for name in names}
    if len(tops) == 1 and (only := f"{tops.pop()}/") + AGENTS in names:
        return only
    found = next((name for name in names if name.endswith(f"/{AGENTS}")), "none")
    raise ArchiveRefused(f"archive: expected {AGENTS} at the top or in the only folder there, found {found:.80}")


def find_style(text: str) -> Style:
    """Which kind of agent a module defines, read without running it. Raises ArchiveRefused."""
    names = {found for pair in _DEFINITION.findall(text) for found in pair}
    for listed in _IMPORT.findall(text):
        names.update(re.findall(r"\w+", " ".join(listed)))
    if "get_entry_point" in names:
        return "joint"
    if "Agent" in names:
        return "agent"
    raise ArchiveRefused(f"{AGENTS}: expected a class Agent or a function get_entry_point in it, found neither")


def find_config(files: Sequence[str], asked: str | None) -> str | None:
    """What the agent is told: the file asked for, MDrive's, or the only one in config/. Raises ArchiveRefused."""
    if asked is not None:
        if asked not in files:
            raise ArchiveRefused(f"model_env.yaml: config: expected a file of the archive, found {asked!r:.80}")
        return asked
    configs = [name for name in files if name.startswith(CONFIG)]
    if SUBMISSION_CONFIG in configs:
        return SUBMISSION_CONFIG
    return configs[0] if len(configs) == 1 else None

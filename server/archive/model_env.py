"""`model_env.yaml`: which environment an agent wants. A conda file is taken as it is, by its name.

    environment: python3.11-numpy     # or `name:`, as conda says it
    config: config/fast.yaml          # optional: the file that the agent is told

Only these lines, `python:` and conda's `- python=3.11` are read. No YAML parser: 5000 brackets keep one busy for a
minute, and the file is a stranger's.
"""

import re
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from server.archive.errors import ArchiveRefused
from server.environments import RECIPES, find_recipe

FILE = "model_env.yaml"
MAX_BYTES = 64 * 1024
KEYS = ("environment", "name", "python", "config")
_CONDA_PYTHON = re.compile(r"[ \t]*-[ \t]+[\"']?python[ \t]*[=<>~!]+[ \t]*(\d+\.\d+)")
_MINOR = re.compile(r"\d+\.\d+")


@dataclass(frozen=True, slots=True)
class ModelEnv:
    """What the file says."""

    environment: str
    config: str | None


def parse_model_env(text: bytes) -> ModelEnv:
    """Reads it; raises ArchiveRefused, which names the environments that there are."""
    said = _parse_lines(text.decode("utf-8", errors="replace"))
    name = said.get("environment") or said.get("name")
    if not name:
        raise ArchiveRefused(f"{FILE}: expected a line `environment: {' | '.join(RECIPES)}`, found none")
    try:
        known = find_recipe(name)
    except InputError as error:
        raise ArchiveRefused(f"{FILE}: {error}") from None
    if (python := said.get("python", known.python)) != known.python:
        raise ArchiveRefused(f"{FILE}: python: expected {known.python}, which {name} has, found {python!r:.20}")
    return ModelEnv(name, said.get("config"))


def _parse_lines(text: str) -> dict[str, str]:
    """What the lines of interest say; of several of one key the last."""
    said: dict[str, str] = {}
    for line in text.splitlines():
        key, colon, value = line.partition(":")
        if colon and key.rstrip() in KEYS:
            said[key.rstrip()] = _unquote(value)
        elif found := _CONDA_PYTHON.match(line):
            said["python"] = found[1]
    if found := _MINOR.match(said.get("python", "")):
        said["python"] = found[0]
    return said


def _unquote(value: str) -> str:
    """Without comment and quotes."""
    return value.partition(" #")[0].strip().strip("\"'")

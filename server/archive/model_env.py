"""`model_env.yaml`: the environment that an agent needs. A conda file is accepted; its name counts.

    environment: python3.11-numpy     # or `name:`, as in conda files
    config: config/fast.yaml          # optional: the agent's configuration file

Only these lines, `python:` and conda's `- python=3.11` are read. No YAML parser is used: the file is untrusted,
and 5000 brackets occupy one for a minute.
"""

import re
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from server.archive.layout import ArchiveRefused
from server.environments import RECIPES, find_recipe

FILE = "model_env.yaml"
MAX_BYTES = 64 * 1024
"""Size limit of the file [bytes], which is read as a whole; chosen: room for a long list of conda packages."""
KEYS = ("environment", "name", "python", "config")
_CONDA_PYTHON = re.compile(r"[ \t]*-[ \t]+[\"']?python[ \t]*[=<>~!]+[ \t]*(\d+\.\d+)")
_MINOR = re.compile(r"\d+\.\d+")


@dataclass(frozen=True, slots=True)
class ModelEnv:
    """The contents of the file."""

    environment: str
    config: str | None


def parse_model_env(text: bytes) -> ModelEnv:
    """Parse the file. Raises ArchiveRefused, which lists the known environments."""
    values = _parse_lines(text.decode("utf-8", errors="replace"))
    name = values.get("environment") or values.get("name")
    if not name:
        raise ArchiveRefused(f"{FILE}: expected a line `environment: {' | '.join(RECIPES)}`, found none")
    try:
        recipe = find_recipe(name)
    except InputError as error:
        raise ArchiveRefused(f"{FILE}: {error}") from None
    if (python := values.get("python", recipe.python)) != recipe.python:
        raise ArchiveRefused(f"{FILE}: python: expected {recipe.python}, which {name} has, found {python!r:.20}")
    return ModelEnv(name, values.get("config"))


def _parse_lines(text: str) -> dict[str, str]:
    """Return the values of the known keys; of several lines with one key the last counts."""
    values: dict[str, str] = {}
    for line in text.splitlines():
        key, colon, value = line.partition(":")
        if colon and key.rstrip() in KEYS:
            values[key.rstrip()] = _unquote(value)
        elif match := _CONDA_PYTHON.match(line):
            values["python"] = match[1]
    if match := _MINOR.match(values.get("python", "")):
        values["python"] = match[0]
    return values


def _unquote(value: str) -> str:
    """Return a value without comment and quotes."""
    return value.partition(" #")[0].strip().strip("\"'")

"""Plug-ins: what other packages add by entry points, and what identifies it in results.

A package names its metrics, agents, scenario sources, readers of recordings and export formats in its `pyproject.toml`:

    [project.entry-points."mdrive_sumo.metrics"]
    episode_length = "my_metrics:EPISODE_LENGTH"

Nothing of it is imported before it is used.
"""

import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from mdrive_sumo.core.checksum import compute_files_checksum
from mdrive_sumo.core.errors import InputError

PREFIX = "mdrive_sumo."


class PlugInKind(StrEnum):
    """The kinds of plug-ins; the entry points of a kind are in the group `mdrive_sumo.KIND`."""

    METRICS = "metrics"
    AGENTS = "agents"
    SCENARIO_SOURCES = "scenario_sources"
    READERS = "readers"
    EXPORT_FORMATS = "export_formats"


@dataclass(frozen=True, slots=True)
class PlugIn:
    """One entry point of another package."""

    kind: PlugInKind
    name: str
    package: str
    """Name of its distribution."""
    version: str
    entry: EntryPoint

    @property
    def locator(self) -> str:
        """Return where its object is: `module:name`."""
        return f"{self.entry.module}:{self.entry.attr}"

    def load(self) -> Any:
        """Import its object. Raises InputError if that fails."""
        try:
            return self.entry.load()
        except (ImportError, AttributeError, SyntaxError) as error:
            raise InputError(f"{self.describe()}: cannot be imported: {error}") from None

    def describe(self) -> str:
        """Return "metrics plug-in 'jerk' of my-metrics 1.2", for messages."""
        return f"{self.kind} plug-in {self.name!r} of {self.package} {self.version}"

    def identify(self) -> str:
        """Return what results and journals hold: "my-metrics 1.2 sha256:...", of all Python files of its package."""
        return f"{self.package} {self.version} {compute_module_checksum(self.entry.module)}"


@lru_cache(maxsize=8)
def list_plug_ins(kind: PlugInKind) -> Mapping[str, PlugIn]:
    """Return the installed plug-ins of a kind by name, sorted.

    Raises InputError for a name that two packages give, and for an entry point that names no object of its module.
    """
    plug_in_by_name: dict[str, PlugIn] = {}
    for entry in sorted(entry_points(group=f"{PREFIX}{kind}"), key=lambda entry: entry.name):
        package, version = (entry.dist.name, entry.dist.version) if entry.dist else ("unknown", "")
        plug_in = PlugIn(kind, entry.name, package, version, entry)
        if (parts := EntryPoint.pattern.match(entry.value)) is None or not parts["attr"]:
            raise InputError(f"{plug_in.describe()}: expected module:object as its entry point, found {entry.value!r}")
        if (other := plug_in_by_name.get(entry.name)) is not None and other.locator != plug_in.locator:
            raise InputError(f"{plug_in.describe()}: expected a name of its own, found that of {other.describe()}")
        plug_in_by_name[entry.name] = plug_in
    return plug_in_by_name


def check_plug_in_names(kind: PlugInKind, built_in: Iterable[str]) -> None:
    """Raise InputError for a plug-in that has the name of something built in."""
    taken = {*built_in}
    for name, plug_in in list_plug_ins(kind).items():
        if name in taken:
            raise InputError(f"{plug_in.describe()}: expected a name of its own, found that of a built-in one")


@lru_cache(maxsize=64)
def compute_module_checksum(module: str) -> str:
    """Return the checksum of all Python files of a module's top-level package; "" if it is not found."""
    root = module.partition(".")[0]
    try:
        spec = importlib.util.find_spec(root)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin is None:
        return ""
    origin = Path(spec.origin)
    files = sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin]
    return compute_files_checksum({path.relative_to(origin.parent).as_posix(): path for path in files})


def identify_plug_ins(kind: PlugInKind, names: Iterable[str] | None = None) -> dict[str, str]:
    """Return what identifies plug-ins of a kind, by "KIND NAME"; names: None for all that are installed."""
    plug_ins = list_plug_ins(kind)
    chosen = plug_ins if names is None else [name for name in names if name in plug_ins]
    return {f"{kind} {name}": plug_ins[name].identify() for name in chosen}

"""Buckets of a season that other packages draw: what they are asked for, and how they are found."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.scenario.suite import SuiteFile

ENTRY_POINTS = "mdrive_sumo.season_buckets"
"""Group of the entry points by which the project's own packages above the library draw a bucket."""


@dataclass(frozen=True, slots=True)
class BucketRequest:
    """A bucket to draw."""

    seed: SeasonSeed
    fingerprint: Fingerprint
    """What makes two tries the same, for a journal in the work folder."""
    about: SuiteFile
    """`suite.json` without its checksum."""
    folder: Path
    """An empty folder that becomes the suite's; it is thrown away if drawing fails."""
    work: Path
    """Folder for what a later try continues with."""
    count: int
    """Number of scenarios."""
    workers: int
    note: Callable[[str], None]
    """Shows a line of progress."""


BucketDrawer = Callable[[BucketRequest], None]
"""Writes scenarios, networks and the sealed `suite.json` into the folder; raises InputError."""


def find_bucket_drawer(bucket: str) -> BucketDrawer:
    """Return the drawer of a bucket by its entry point in `mdrive_sumo.season_buckets`. Raises InputError."""
    found = list(entry_points(group=ENTRY_POINTS, name=bucket))
    if not found:
        raise InputError(
            f"--bucket {bucket}: expected a package that draws it (entry point {ENTRY_POINTS}),"
            " found none: `pip install .` in the project's folder installs that of real2sim"
        )
    return found[0].load()

"""Several runs that are compared: loaded, checked to be comparable, and named A, B, C."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_place
from mdrive_sumo.report.result_tables import describe_agent
from mdrive_sumo.runs.compare import select_shared_versions
from mdrive_sumo.runs.stored_run import StoredRun, load_viewed_run

MAX_RUNS = len(ascii_uppercase)


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """One of the runs of a comparison."""

    letter: str
    folder: Path
    stored: StoredRun

    @property
    def place(self) -> str:
        """The folder as a page names it: never as an absolute path."""
        return hide_place(self.folder)

    @property
    def agent(self) -> str:
        """The agent with its labels."""
        return describe_agent(self.stored.results)


def load_compared_runs(folders: Sequence[Path], suite: str | None) -> tuple[ComparedRun, ...]:
    """Load runs and name them A, B, C in their order. suite: the suite's place now if it has moved.

    Raises InputError for a run that is named twice, and for runs of different suites, score modes or versions.
    """
    if len(folders) > MAX_RUNS:
        raise InputError(f"view: expected at most {MAX_RUNS} runs, found {len(folders)}")
    places = [folder.resolve() for folder in folders]
    if twice := next((folder for folder, place in zip(folders, places, strict=True) if places.count(place) > 1), None):
        raise InputError(f"view: expected different runs, found {str(twice)!r} twice")
    runs = tuple(
        ComparedRun(letter, folder, load_viewed_run(folder, suite))
        for letter, folder in zip(ascii_uppercase, folders, strict=False)
    )
    for run in runs[1:]:
        _check_comparable(runs[0], run)
    return runs


def _check_comparable(first: ComparedRun, other: ComparedRun) -> None:
    a, b = first.stored.results.run, other.stored.results.run
    compared = {
        "suite": (f"{a.suite} {a.suite_checksum[7:19]}", f"{b.suite} {b.suite_checksum[7:19]}"),
        "score mode": (a.score_mode, b.score_mode),
        "versions": tuple(map(_format_versions, select_shared_versions(a, b))),
    }
    remedies = {
        "suite": "runs of one suite can be compared",
        "score mode": "`mdrive-sumo rescore` brings them together",
        "versions": "`mdrive-sumo compare` compares their scores with a warning",
    }
    for what, (here, there) in compared.items():
        if here != there:
            raise InputError(
                f"view: expected runs with the same {what}, found {here} in {first.folder} and {there} in"
                f" {other.folder}; {remedies[what]}"
            )


def _format_versions(versions: dict[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))

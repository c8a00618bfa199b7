"""`drive.json`: what a drive was started with, so that `mdrive-sumo drive --resume DIR` needs no other option."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.core.suggestion import shorten_name
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.scenario.packaged_suites import name_exactly
from mdrive_sumo.scenario.season import read_stored_name, write_stored_name
from server.drive.session_rules import SessionRules
from server.drive.simulation_values import DriveSetup

DRIVE_FILE = "drive.json"
MAX_DRIVE_FILE_BYTES = 2**20
"""It has about 1 kB; a channel with many muted senders more."""


class DriveFile(BaseModel):
    """The contents of `drive.json`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: Literal["mdrive-sumo/drive-settings/1"] = "mdrive-sumo/drive-settings/1"
    scenario: str
    people: list[str]
    suite: str
    seed: int
    others: str
    substitutes: list[str]
    v2x: str
    options: dict[str, str | int | float | bool]
    from_run: str | None
    from_tick: int
    weather: str
    on_disconnect: str


@dataclass(frozen=True, slots=True)
class StoredDrive:
    """Setup and rules of a drive."""

    setup: DriveSetup
    rules: SessionRules


def save_drive(drive: StoredDrive) -> None:
    """Write the settings of a drive into its folder. Raises InputError where that cannot be written."""
    setup = drive.setup
    content = DriveFile(
        scenario=setup.scenario,
        people=list(setup.people),
        suite=write_stored_name(name_exactly(setup.suite)),
        seed=setup.seed,
        others=setup.others,
        substitutes=list(setup.substitutes),
        v2x=setup.v2x,
        options=dict(setup.options.to_dict()),
        from_run=None if setup.from_run is None else str(setup.from_run.resolve()),
        from_tick=setup.from_tick,
        weather=setup.weather,
        on_disconnect=drive.rules.on_disconnect,
    )
    try:
        make_folder(setup.folder)
        write_text(setup.folder / DRIVE_FILE, content.model_dump_json(indent=1) + "\n")
    except OSError as error:
        raise InputError(f"{setup.folder}: cannot be written: {error.strerror}; --out names another folder") from None


def load_drive(folder: Path) -> StoredDrive:
    """Return the settings of the drive in a folder. Raises InputError."""
    path = folder / DRIVE_FILE
    try:
        content = DriveFile.model_validate_json(read_bytes(path, MAX_DRIVE_FILE_BYTES))
    except FileNotFoundError:
        raise InputError(
            f"--resume {folder}: expected a folder of `mdrive-sumo drive`, found none with {DRIVE_FILE}"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {_describe(error)}") from None
    return StoredDrive(_make_setup(folder, content), SessionRules(on_disconnect=content.on_disconnect))


def _describe(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    said = str(first["msg"]).removeprefix("Input should be ")
    if first["type"] == "json_invalid":
        return f"expected JSON, found none ({said})"
    place, found = ": ".join(map(str, first["loc"])), shorten_name(str(first["input"]))
    return f"{place}: expected {said[:1].lower()}{said[1:]}, found {found}"


def _make_setup(folder: Path, content: DriveFile) -> DriveSetup:
    values: dict[str, Any] = content.options
    try:
        options = EpisodeOptions.from_dict(values)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / DRIVE_FILE}: options: expected those of an episode, found {error}") from None
    return DriveSetup(
        scenario=content.scenario,
        folder=folder,
        people=tuple(content.people),
        suite=read_stored_name(content.suite),
        seed=content.seed,
        others=content.others,
        substitutes=tuple(content.substitutes),
        v2x=content.v2x,
        options=options,
        from_run=None if content.from_run is None else Path(content.from_run),
        from_tick=content.from_tick,
        weather=content.weather,
    )

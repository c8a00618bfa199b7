"""Files of a place: a network folder with `place.json`, from which it can be drawn again."""

import tempfile
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import copy_file, make_folder, write_text
from mdrive_sumo.roads import find_network_folder
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE
from mdrive_sumo.worlds.places.draw_place import PLACE_KINDS, draw_place
from mdrive_sumo.worlds.places.place import PLACE_FILE, Place
from mdrive_sumo.worlds.places.place_parameters import PLACES_VERSION, Value
from mdrive_sumo.worlds.places.recipe import build_draft


class PlaceFile(BaseModel):
    """What a place was drawn from."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    format: Literal["mdrive-sumo/place/1"] = "mdrive-sumo/place/1"
    version: int
    """`PLACES_VERSION` of the release that drew it."""
    kind: str
    seed: int | str
    parameters: dict[str, Value]


def write_place(place: Place, folder: Path) -> Path:
    """Write the network of a place into `folder`: `map.net.xml.gz`, `network.json` and `place.json`; return `folder`.

    Raises InputError if SUMO's netconvert is missing. The recipe in plain XML is not kept: `read_place` draws it again.
    """
    make_folder(folder)
    if place.kind in PLACE_KINDS and place.draft is not None:
        with tempfile.TemporaryDirectory() as scratch:
            build_draft(place.draft, Path(scratch))
            _copy_network(Path(scratch), folder)
    else:
        _copy_network(find_network_folder(place.kind), folder)
    about = PlaceFile(version=PLACES_VERSION, kind=place.kind, seed=place.seed, parameters=dict(place.parameters))
    write_text(folder / PLACE_FILE, about.model_dump_json(indent=1) + "\n")
    return folder


def _copy_network(source: Path, folder: Path) -> None:
    for name in (NET_FILE, NETWORK_FILE):
        copy_file(source / name, folder / name)


def read_place(folder: Path) -> Place:
    """Draw the place of a folder again, from its `place.json`. Raises InputError, also for one of another version."""
    path = folder / PLACE_FILE
    try:
        about = PlaceFile.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in problem["loc"]) or "the file"
        raise InputError(f"{path}: {where}: {problem['msg']}") from None
    if about.version != PLACES_VERSION:
        raise InputError(
            f"{path}: expected a place of version {PLACES_VERSION}, which this release draws,"
            f" found version {about.version}: install the release that wrote it, or draw the place anew"
        )
    return draw_place(about.kind, about.seed, **about.parameters)

"""Camera images beside a recording: JPEG files in a zip archive, for people to look at. They belong to no digest."""

import io
import json
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from PIL import Image

from mdrive_sumo.contract import CameraImage, Observation
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from mdrive_sumo.core.output_files import NewFile, make_parents

MAX_WIDTH_PX = 480
"""Wider images are made smaller."""
QUALITY = 75
"""Quality of the JPEG files, Pillow's default: for people to look at, no agent sees these files."""
MAX_ARCHIVE_BYTES = 64 * 2**20
"""Bytes of an episode's images, about 7 000 images. What comes later is left out."""
MAX_FILE_BYTES = 3 * MAX_ARCHIVE_BYTES
"""Bytes of an archive with its index and what zip adds to each image."""
MAX_IMAGE_BYTES = 2**20
"""Largest image that is read: more than the pixels of `MAX_WIDTH_PX` x 700, uncompressed."""
MAX_IMAGES = 100_000
"""More than ten times as many as `MAX_ARCHIVE_BYTES` hold of usual images."""
INDEX = "index.json"
_TIME = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all members: the same images give the same bytes."""
Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CameraTrack:
    """The images that one camera of a CAV gave, by ascending tick."""

    ego: str
    camera: str
    images: dict[int, bytes] = field(default_factory=dict[int, bytes])
    """JPEG files by tick."""


class CameraArchiveWriter:
    """Writes the images (`rgb`) that agents get; a context manager that leaves no file without images."""

    def __init__(self, path: Path) -> None:
        """The file and its folder are made for the first image."""
        self._path = path
        self._new: NewFile | None = None
        self._archive: zipfile.ZipFile | None = None
        self._number_by_camera: dict[tuple[str, str], int] = {}
        self._size, self._left_out = 0, 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None) -> None:
        """Finish the archive; drop it after an error. Without images there is none, nor its folder."""
        if self._archive is None or self._new is None:
            self._path.unlink(missing_ok=True)
            return
        is_kept = False
        try:
            if kind is None:
                cameras = [{"ego": ego, "camera": camera} for ego, camera in self._number_by_camera]
                self._write(INDEX, json.dumps({"cameras": cameras, "left_out": self._left_out}).encode())
                self._archive.close()
                self._new.keep()
                is_kept = True
        finally:
            if not is_kept:  # also where the disk is full
                with suppress(OSError):
                    self._archive.close()
                self._new.drop()
                self._path.unlink(missing_ok=True)

    def add(self, tick: int, observations: Mapping[str, Observation]) -> None:
        """Write the images of a tick, by CAV id."""
        for ego, observation in observations.items():
            for camera, image in observation.cameras.items():
                if image.kind == "rgb":
                    self._add_image(tick, (ego, camera), image)

    def _add_image(self, tick: int, camera: tuple[str, str], image: CameraImage) -> None:
        data = encode_image(image.pixels.astype(np.uint8, copy=False))
        if self._size + len(data) > MAX_ARCHIVE_BYTES:
            self._left_out += 1
            return
        self._size += len(data)
        number = self._number_by_camera.setdefault(camera, len(self._number_by_camera))
        self._write(f"{number}/{tick:06d}.jpg", data)

    def _write(self, name: str, data: bytes) -> None:
        if self._archive is None:
            make_parents(self._path)
            self._new = NewFile(self._path)
            self._archive = zipfile.ZipFile(self._new.file, "w", zipfile.ZIP_STORED)
        self._archive.writestr(zipfile.ZipInfo(name, _TIME), data)


def encode_image(pixels: Pixels) -> bytes:
    """Return an image (H, W, 3) as a JPEG file of at most `MAX_WIDTH_PX`."""
    image = Image.fromarray(pixels)
    if image.width > MAX_WIDTH_PX:
        image = image.reduce(-(-image.width // MAX_WIDTH_PX))
    file = io.BytesIO()
    image.save(file, "JPEG", quality=QUALITY)
    return file.getvalue()


def load_camera_tracks(path: Path) -> list[CameraTrack]:
    """Return the images of an archive. Raises InputError for a corrupt one, also from a stranger."""
    try:
        with open_regular(path, MAX_FILE_BYTES) as file, zipfile.ZipFile(file) as archive:
            return _read_tracks(archive)
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        EOFError,
        zipfile.BadZipFile,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise InputError(
            f"{path}: expected camera images of `eval --record-cameras`, found a corrupt file ({error})"
        ) from None


def _read_tracks(archive: zipfile.ZipFile) -> list[CameraTrack]:
    """Return the images. Raises ValueError, KeyError and TypeError for unexpected content."""
    members = archive.infolist()
    large = any(one.file_size > MAX_IMAGE_BYTES or one.compress_type != zipfile.ZIP_STORED for one in members)
    if large or len(members) > MAX_IMAGES or sum(one.file_size for one in members) > 2 * MAX_ARCHIVE_BYTES:
        raise ValueError("stored images of a bounded size expected, found others")
    index: Any = json.loads(archive.read(INDEX))
    tracks = [CameraTrack(str(entry["ego"]), str(entry["camera"])) for entry in index["cameras"]]
    for name in sorted(one.filename for one in members if one.filename != INDEX):
        number, _, rest = name.partition("/")
        tracks[_read_number(number)].images[_read_number(rest.removesuffix(".jpg"))] = archive.read(name)
    return tracks


def _read_number(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 6):
        raise ValueError(f"a number expected, found {text[:40]!r}")
    return int(text)

"""Takes in an upload: a multipart form of a few short fields and one file, which goes to disk as it comes.

The whole is never in memory; size and checksum are known with the last byte.
"""

import asyncio
import hashlib
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from mdrive_sumo.core.errors import InputError
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.problems import ProblemError
from server.store.errors import new_id

FILE_FIELD = "archive"
UPLOAD_S = 900.0
"""For the whole of it: a slow line needs some minutes, who sends a byte a minute has no place here."""
MAX_UPLOADS = 8
"""Uploads of one team that arrive at the same time."""
FORM_BYTES = 64 * 1024
"""What a form may have besides its file."""
_FIELD_BYTES = 1024


@dataclass(frozen=True, slots=True)
class Upload:
    """What came."""

    file: Path
    """It goes when the upload's context ends, unless it was moved away."""
    bytes: int
    sha256: str
    fields: dict[str, str]


class Uploads(ConcurrencyLimit):
    """Those that are arriving: quotas are counted when an archive is there, and disks are full before."""

    def __init__(self) -> None:
        super().__init__("upload", MAX_UPLOADS)


@asynccontextmanager
async def receive_upload(request: Request, names: frozenset[str], folder: Path, most: int) -> AsyncGenerator[Upload]:
    """Reads the request's body into a new file in `folder`. `names`: fields that a form may have besides the file.

    Raises ProblemError for what is too large, too slow or no form; InputError for fields that are not as expected.
    """
    _check_length(request, most)
    part = folder / f"{new_id()}.part"
    try:
        with part.open("xb") as file:
            form = _Form(file, names, most)
            request.state.form = form.fields
            await _read(request, form)
        yield form.upload(part)
    finally:
        part.unlink(missing_ok=True)


def received_fields(request: Request) -> dict[str, str]:
    """The fields that have come so far: to show the form again where an upload was refused."""
    found: dict[str, bytearray] = getattr(request.state, "form", {})
    return {name: value.decode("utf-8", "replace") for name, value in found.items()}


async def _read(request: Request, form: "_Form") -> None:
    boundary, left = _boundary(request), form.most + FORM_BYTES
    try:
        parser = MultipartParser(boundary, form.callbacks())  # pyright: ignore[reportArgumentType]
        async with asyncio.timeout(UPLOAD_S):
            async for chunk in request.stream():
                left -= len(chunk)
                if left < 0:
                    raise _too_large(form.most)
                parser.write(chunk)
        parser.finalize()
    except FormParserError as error:
        raise _broken(str(error)) from None
    except TimeoutError:
        sentence = f"upload: expected all of it within {UPLOAD_S:.0f} s, found it unfinished"
        raise ProblemError(HTTPStatus.REQUEST_TIMEOUT, "slow", sentence) from None


def _check_length(request: Request, most: int) -> None:
    """Before anything is read: most clients say how much they send."""
    length = request.headers.get("content-length", "")
    if length.isdecimal() and int(length) > most + FORM_BYTES:
        raise _too_large(most)


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data":
        sentence = f"upload: expected multipart/form-data, found {kind.decode('latin-1') or 'nothing'!r:.60}"
        raise ProblemError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "form", sentence)
    if not options.get(b"boundary"):
        raise _broken("its boundary is missing")
    return options[b"boundary"]


@dataclass(slots=True)
class _Form:
    """What the parser has found so far."""

    file: BinaryIO
    names: frozenset[str]
    most: int
    size: int = 0
    ended: bool = False
    seen_file: bool = False
    digest: Any = field(default_factory=hashlib.sha256)
    fields: dict[str, bytearray] = field(default_factory=lambda: {})
    name: str = ""
    """Of the part that is being read."""
    header: bytearray = field(default_factory=bytearray)
    value: bytearray = field(default_factory=bytearray)

    def callbacks(self) -> dict[str, object]:
        """For the parser."""
        return {
            "on_part_begin": self._begin,
            "on_header_field": self._header,
            "on_header_value": self._value,
            "on_header_end": self._headed,
            "on_headers_finished": self._named,
            "on_part_data": self._data,
            "on_end": self._end,
        }

    def upload(self, part: Path) -> Upload:
        """All of it, or a problem."""
        if not self.ended:
            raise _broken("it ends in the middle")
        if not self.seen_file:
            raise InputError(f"upload: expected a file in the field {FILE_FIELD}, found none")
        try:
            texts = {name: bytes(value).decode("utf-8") for name, value in self.fields.items()}
        except UnicodeDecodeError:
            raise InputError("upload: expected fields in UTF-8, found other bytes") from None
        return Upload(part, self.size, self.digest.hexdigest(), texts)

    def _begin(self) -> None:
        self.name = ""

    def _header(self, data: bytes, start: int, end: int) -> None:
        self.header.extend(data[start:end])

    def _value(self, data: bytes, start: int, end: int) -> None:
        self.value.extend(data[start:end])

    def _headed(self) -> None:
        if bytes(self.header).lower() == b"content-disposition":
            _, options = parse_options_header(bytes(self.value))
            self.name = options.get(b"name", b"").decode("utf-8", "replace")
        self.header.clear()
        self.value.clear()

    def _named(self) -> None:
        if self.name == FILE_FIELD and not self.seen_file:
            self.seen_file = True
        elif self.name in self.names and self.name not in self.fields:
            self.fields[self.name] = bytearray()
        else:
            known = ", ".join((*sorted(self.names), FILE_FIELD))
            raise InputError(f"upload: expected the fields {known}, each once, found {self.name!r:.60}")

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self.name != FILE_FIELD:
            text = self.fields[self.name]
            if len(text) + end - start > _FIELD_BYTES:
                raise InputError(f"upload: {self.name}: expected at most {_FIELD_BYTES} bytes, found more")
            text.extend(data[start:end])
            return
        self.size += end - start
        if self.size > self.most:
            raise _too_large(self.most)
        piece = memoryview(data)[start:end]
        self.digest.update(piece)
        self.file.write(piece)

    def _end(self) -> None:
        self.ended = True


def _too_large(most: int) -> ProblemError:
    sentence = f"archive: expected at most {most} bytes, found more"
    return ProblemError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too-large", sentence)


def _broken(said: str) -> ProblemError:
    return ProblemError(
        HTTPStatus.BAD_REQUEST, "form", f"upload: expected a multipart form, found a broken one ({said})"
    )

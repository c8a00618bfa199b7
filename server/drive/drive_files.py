"""Static files of the driving page: its own, and those that it shares with replays."""

import gzip
import hashlib
import mimetypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

from fastapi import Request, Response

ROOTS = ("server.drive", "mdrive_sumo.report")
"""Packages whose folder `static` is served; the first one that has a file gives it."""
KINDS = (".css", ".js", ".svg", ".woff2", ".png", ".txt", ".html")
COMPRESSED_KINDS = (".css", ".js", ".svg", ".txt", ".html")
"""Text, which gzip makes four times smaller: a page of 1 MB is there in a quarter of the time."""


@dataclass(frozen=True, slots=True)
class StaticFile:
    """A file as it is sent."""

    content: bytes
    compressed: bytes | None
    media_type: str
    tag: str
    """Hash of the contents (ETag)."""


def read_static_file(name: str) -> StaticFile | None:
    """Return a static file by name; None if there is none. What is asked for in vain is not kept."""
    return _load(name) if name in _list_files() else None


@cache
def _list_files() -> Mapping[str, Traversable]:
    folders = [files(root).joinpath("static") for root in reversed(ROOTS)]
    return {file.name: file for folder in folders for file in folder.iterdir() if file.name.endswith(KINDS)}


@cache
def _load(name: str) -> StaticFile:
    content = _list_files()[name].read_bytes()
    compressed = gzip.compress(content, mtime=0) if name.endswith(COMPRESSED_KINDS) else None
    media_type = mimetypes.guess_type(name)[0] or "application/octet-stream"
    return StaticFile(content, compressed, media_type, f'"{hashlib.sha256(content).hexdigest()[:16]}"')


def send_static_file(request: Request, file: StaticFile, headers: dict[str, str]) -> Response:
    """Return a response with a file, compressed where the browser takes that; 304 if the browser has it."""
    headers = {**headers, "ETag": file.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if request.headers.get("if-none-match") == file.tag:
        return Response(status_code=304, headers=headers)
    if file.compressed is not None and "gzip" in request.headers.get("accept-encoding", ""):
        return Response(file.compressed, media_type=file.media_type, headers=headers | {"Content-Encoding": "gzip"})
    return Response(file.content, media_type=file.media_type, headers=headers)

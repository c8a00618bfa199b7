"""Style sheets, scripts and images: read once, with a hash of their contents in the URL."""

import hashlib
import mimetypes
from dataclasses import dataclass
from importlib.resources import files

from fastapi import APIRouter, Response

from server.store import NotFound

router = APIRouter()
_KINDS = (".css", ".js", ".svg")
_FOR_EVER = "public, max-age=31536000, immutable"


@dataclass(frozen=True, slots=True)
class _Asset:
    content: bytes
    media_type: str
    version: str


def _read() -> dict[str, _Asset]:
    assets: dict[str, _Asset] = {}
    for file in files("server.web").joinpath("static").iterdir():
        if file.name.endswith(_KINDS):
            content = file.read_bytes()
            media_type = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
            assets[file.name] = _Asset(content, media_type, hashlib.sha256(content).hexdigest()[:12])
    return assets


_ASSETS = _read()


def static_url(name: str) -> str:
    """Return the URL of a file in `static`; it changes with the contents, so browsers may cache it for ever."""
    return f"/static/{_ASSETS[name].version}/{name}"


@router.get("/static/{version}/{name}")
async def asset(version: str, name: str) -> Response:
    """Return a static file."""
    wanted = _ASSETS.get(name)
    if wanted is None or wanted.version != version:
        raise NotFound(f"there is nothing at /static/{version:.20}/{name:.60}")
    headers = {"Cache-Control": _FOR_EVER, "X-Content-Type-Options": "nosniff"}
    return Response(wanted.content, media_type=wanted.media_type, headers=headers)

"""OnnxManifest: what a file of weights is, in the JSON file beside it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_text

FORMAT_VERSION = 1
"""Raised when weights of earlier versions do not fit any more: inputs, outputs or their meaning have changed."""


class OnnxManifest(BaseModel):
    """Facts about NAME.onnx, kept in NAME.json."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format_version: int = FORMAT_VERSION
    system: str
    """Name of what the weights are of."""
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    """Of the .onnx file, hexadecimal."""
    bytes: int = Field(ge=1)
    """Size of the .onnx file."""
    parameters: int = Field(ge=0)
    """Number of trained numbers."""
    training: Mapping[str, JsonValue] = Field(default_factory=dict)
    """Summary of the training: data, seeds, steps, rounds, device, measured errors. Nothing reads it to drive."""

    def __hash__(self) -> int:
        """Of the checksum: mappings have no hash."""
        return hash((self.system, self.sha256))


Manifest = TypeVar("Manifest", bound=OnnxManifest)


def read_manifest(path: Path, kind: type[Manifest]) -> Manifest:
    """Return a manifest. Raises InputError for a missing, unreadable or invalid file, or another format version."""
    try:
        data: Any = json.loads(read_bytes(path))
    except OSError as error:
        raise InputError(f"manifest of weights {path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # recursion: brackets nested a thousand times
        raise InputError(f"manifest of weights {path}: expected JSON, found an error: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"manifest of weights {path}: expected a JSON object, found {type(data).__name__}")
    if (version := data.get("format_version")) != FORMAT_VERSION:
        raise InputError(
            f"manifest of weights {path}: expected format version {FORMAT_VERSION}, found {version!r:.40};"
            " use weights that this version of mdrive-sumo has exported"
        )
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise InputError(
            f"manifest of weights {path}: {where}: {problem['msg']}, found {problem['input']!r:.60}"
        ) from None


def write_manifest(manifest: OnnxManifest, path: Path) -> None:
    """Write a manifest."""
    write_text(path, json.dumps(manifest.model_dump(mode="json"), indent=1) + "\n")

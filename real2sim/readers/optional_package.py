"""Packages of the extra `convert` that single readers need."""

from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation


def build_missing_error(path: Path, package: str) -> InputError:
    """Return the error for a file that needs a package that is not installed."""
    return InputError(f"{path}: expected {package} to be installed, found none: {format_installation('convert')}")

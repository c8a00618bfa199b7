"""require_torch: one sentence where PyTorch is missing."""

from importlib.util import find_spec

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

NEEDED = ("torch", "onnx")


def require_torch(command: str, *more: str) -> None:
    """Raises InputError that names what to install for a command, if PyTorch, onnx or one of `more` is missing."""
    missing = [name for name in (*NEEDED, *more) if find_spec(name) is None]
    if missing:
        raise InputError(
            f"{command}: expected {', '.join((*NEEDED, *more))} to be installed, found no {' and no '.join(missing)};"
            f" {format_installation('learn', 'learned')}"
        )

"""require_torch: one sentence where PyTorch is missing."""

from importlib.util import find_spec

from mdrive_sumo.core.errors import InputError

NEEDED = ("torch", "onnx")


def require_torch(command: str) -> None:
    """Raises InputError that names what to install for a command, if something is missing."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise InputError(f"{command} needs {' and '.join(missing)}: pip install 'mdrive-sumo[learn]'")

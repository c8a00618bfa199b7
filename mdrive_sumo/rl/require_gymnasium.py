"""require_gymnasium: one sentence where Gymnasium or PettingZoo is missing."""

from importlib.util import find_spec

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

NEEDED = ("gymnasium", "pettingzoo")


def require_gymnasium() -> None:
    """Raises InputError that names what to install, if Gymnasium or PettingZoo is missing."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise InputError(
            f"mdrive_sumo.rl: expected {' and '.join(NEEDED)} to be installed, found no {' and no '.join(missing)};"
            f" {format_installation('rl')}"
        )

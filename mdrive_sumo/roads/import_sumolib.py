"""Import sumolib without what it would bring along."""

import sys
from types import ModuleType


def import_sumolib() -> ModuleType:
    """Return sumolib, imported without pyproj: 10 MB and 0.15 s in every worker for projections that nothing here uses.

    sumolib does without it if it cannot be imported. Called late, because the rest takes 0.1 s that `--help` should not
    pay.
    """
    is_hidden = "pyproj" not in sys.modules and "sumolib" not in sys.modules
    if is_hidden:
        sys.modules["pyproj"] = None  # pyright: ignore[reportArgumentType] - documented: an import then fails
    try:
        import sumolib
    finally:
        if is_hidden:
            del sys.modules["pyproj"]
    return sumolib

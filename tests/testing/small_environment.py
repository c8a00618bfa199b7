"""An environment for boxed agents of tests: this Python with the packages of `python3.11-numpy` and no others.

Boxes of a server copy their environment, and the packages of a developer's own are gigabytes.
"""

import json
import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path

from server import environments

PACKAGES = ("numpy", "numpy.libs", "msgpack", "yaml", "_yaml")


def describe_small_environment(about: Path) -> None:
    """Write the file that describes it into its folder, and its packages beside it: links where possible."""
    made = replace(environments.current_environment(), site=link_packages(about / "site"))
    (about / environments.ABOUT_FILE).write_text(json.dumps(asdict(made), default=str))


def link_packages(site: Path) -> Path:
    """Fill a folder with the packages of the environment; returns its absolute path."""
    found = environments.current_environment().site
    assert found is not None
    for name in PACKAGES:
        if (found / name).is_dir():
            shutil.copytree(found / name, site / name, copy_function=_link_or_copy)
    return site.absolute()


def _link_or_copy(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)

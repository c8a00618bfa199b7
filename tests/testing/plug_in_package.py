"""A package with plug-ins, installed for one test without a network: a module and a dist-info folder on sys.path."""

import os
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib import invalidate_caches
from pathlib import Path

import pytest

from mdrive_sumo.core import plug_ins
from mdrive_sumo.scenario import packaged_suites
from mdrive_sumo.scoring.metrics import registry

MODULE = "tiny_plug_ins"


def forget_plug_ins() -> None:
    """Forget what was found installed."""
    for module in (MODULE, "mdrive_sumo.cli.export"):  # the command's options list the formats
        sys.modules.pop(module, None)
    for function in (
        plug_ins.list_plug_ins,
        plug_ins.compute_module_checksum,
        registry.load_metric_plug_ins,
        packaged_suites.find_source_folder,
    ):
        function.cache_clear()


@contextmanager
def install_package(
    folder: Path, source: str, entry_points: Mapping[str, Mapping[str, str]], name: str = "tiny-plug-ins"
) -> Generator[Path]:
    """Install a package with the entry points `{kind: {name: object}}` until the end of the block; yield its module."""
    folder.mkdir(parents=True, exist_ok=True)
    module = folder / f"{MODULE}.py"
    module.write_text(source)
    about = folder / f"{name.replace('-', '_')}-1.2.dist-info"
    about.mkdir(exist_ok=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    groups = [
        f"[mdrive_sumo.{kind}]\n" + "".join(f"{key} = {MODULE}:{place}\n" for key, place in entries.items())
        for kind, entries in entry_points.items()
    ]
    (about / "entry_points.txt").write_text("\n".join(groups))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)  # for the processes of agents
        invalidate_caches()
        forget_plug_ins()
        try:
            yield module
        finally:
            forget_plug_ins()

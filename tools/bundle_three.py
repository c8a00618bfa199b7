"""Bundle the parts of three.js that the 3-D view uses: `python -m tools.bundle_three`.

Needs Node.js with npm, and fetches the two pinned packages; neither users nor tests need either. The committed file is
the output, byte for byte: a test compares its SHA-256 with the stated one.
"""

import hashlib
import json
import re
import subprocess
import tempfile
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file, write_text
from mdrive_sumo.core.terminal import echo
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

PACKAGES = {"three": "0.187.0", "esbuild": "0.28.2"}
"""Versions of three.js (MIT licence) and of the bundler, which adds nothing of its own but a wrapper."""
BUNDLE_SHA256 = "993d2b52f891556ec2cb442a3cd63086bb3dba7aa7cd27469ad82c8e9f0f0a5e"
STATIC = Path(__file__).parents[1] / "mdrive_sumo" / "report" / "static"
BUNDLE, LICENCE = "three.min.js", "three.LICENSE"
BANNER = f"/* three.js {PACKAGES['three']}, MIT licence, see {LICENCE}; made by tools/bundle_three.py */"
FLAGS = (
    *("--bundle", "--minify", "--format=iife", "--global-name=THREE", "--target=es2022", "--legal-comments=none"),
    f"--banner:js={BANNER}",
)


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Write three.min.js and its licence into mdrive_sumo/report/static."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "built"
        built.mkdir()
        build_bundle(Path(folder), built)
        found = hashlib.sha256((built / BUNDLE).read_bytes()).hexdigest()
        for path in replace_changed_files(built, STATIC, dry_run=dry_run):
            echo(f"{'would write' if dry_run else 'wrote'} {path}")
    if found != BUNDLE_SHA256:
        raise InputError(f"{BUNDLE}: expected the SHA-256 {BUNDLE_SHA256}, found {found}; state it in {__file__}")


def list_names() -> list[str]:
    """Return what the scripts of the view take from three.js."""
    scripts = "".join(path.read_text("utf-8") for path in sorted(STATIC.glob("view_3d*.js")))
    return sorted(set(re.findall(r"\bTHREE\.(\w+)", scripts)))


def build_bundle(work: Path, target: Path) -> None:
    """Fetch the packages into `work`, and write the bundle and the licence into `target`. Raises InputError."""
    write_text(work / "package.json", json.dumps({"private": True, "dependencies": PACKAGES}))
    _call(["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts"], work)
    write_text(work / "entry.js", f'export {{ {", ".join(list_names())} }} from "three";\n')
    _call(["node_modules/.bin/esbuild", "entry.js", *FLAGS, f"--outfile={target / BUNDLE}"], work)
    copy_file(work / "node_modules/three/LICENSE", target / LICENCE)


def _call(command: list[str], folder: Path) -> None:
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise InputError(f"{command[0]}: expected this command (Node.js with npm), found none") from None
    if done.returncode:
        trouble = f"exit code {done.returncode}: {done.stderr[-500:]}"
        raise InputError(f"{' '.join(command)}: expected success, found {trouble}")


if __name__ == "__main__":
    main()

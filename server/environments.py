"""The environments that agents run in: named and made beforehand; no participant's code has a part in that."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import BoxError, BoxLimits, BoxSpec, open_box
from mdrive_sumo.core.errors import InputError

ABOUT_FILE = "environment.json"
BUILD_S = 1800.0
IMAGE_PYTHON = "/opt/agent/bin/python"
"""Where the agent image of `docker/Dockerfile` has its interpreter."""
PROGRAMS = ("opt", "usr")
"""Where images have programs."""
PROBE = """
import importlib.metadata as metadata, sys
print("%d.%d" % sys.version_info[:2])
for name, version in sorted({(found.name.lower(), found.version) for found in metadata.distributions()}):
    print(name + "==" + version)
"""
"""What an image is asked about itself."""
PROBE_S = 60.0


@dataclass(frozen=True, slots=True)
class EnvironmentRecipe:
    """What an environment is made of."""

    name: str
    python: str
    """Version of the interpreter: major.minor."""
    packages: tuple[str, ...]
    """Exact, because an agent's results depend on them. `msgpack` is what the line to the evaluator needs."""
    memory_bytes: int
    """What a box needs for this environment at least."""


MEBIBYTE = 1024 * 1024
BASE = ("msgpack==1.2.4", "numpy==2.4.6", "pyyaml==6.0.3")
"""PyYAML, because agents of the CARLA leaderboard read their options with it."""
RECIPES: Mapping[str, EnvironmentRecipe] = {
    find_recipe.name: find_recipe
    for find_recipe in (
        EnvironmentRecipe("python3.11-numpy", "3.11", BASE, 512 * MEBIBYTE),
        EnvironmentRecipe("python3.11-torch-cpu", "3.11", (*BASE, "torch==2.13.0+cpu"), 2048 * MEBIBYTE),
    )
}


@dataclass(frozen=True, slots=True)
class Environment:
    """One that is made, as `AgentBox` expects it."""

    name: str
    python: Path
    """Interpreter; with `rootfs` as seen in there."""
    site: Path | None
    """Folder with the packages; None: the interpreter finds them by itself."""
    packages: tuple[str, ...]
    """Everything in it, name==version: the same archive drives as before only with the same ones."""
    rootfs: Path | None = None
    """Unpacked image that boxes see in place of their host's programs."""
    image: str = ""
    """Checksum of the names and sizes of its programs, as it was imported."""


def find_recipe(name: str) -> EnvironmentRecipe:
    """Raises InputError, which names those that there are."""
    if name not in RECIPES:
        raise InputError(f"environment: expected one of {', '.join(RECIPES)}, found {name!r:.60}")
    return RECIPES[name]


def load_environment(name: str, folder: Path) -> Environment:
    """A built one of a folder of environments. Raises InputError if there is none of that name, or it is not built."""
    find_recipe(name)
    about = folder / name / ABOUT_FILE
    try:
        found = json.loads(about.read_text("utf-8"))
        site, rootfs = (Path(found[key]) if found.get(key) else None for key in ("site", "rootfs"))
        return Environment(name, Path(found["python"]), site, tuple(found["packages"]), rootfs, found.get("image", ""))
    except FileNotFoundError:
        raise InputError(
            f"environment {name}: not built in {folder}; run mdrive-sumo admin environment build {name}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{about}: expected a description of an environment, found none ({error})") from None


def compute_digest(name: str, folder: Path) -> str | None:
    """Of what a built environment holds; None where there is none, which whoever drives with it will say."""
    try:
        found = load_environment(name, folder)
    except InputError:
        return None
    return hashlib.sha256(json.dumps([found.packages, found.image]).encode()).hexdigest()[:16]


def list_built(folder: Path) -> list[str]:
    """Names of those that a folder of environments has."""
    return [name for name in RECIPES if (folder / name / ABOUT_FILE).is_file()]


def current_environment() -> Environment:
    """This interpreter with its own packages: for a dry run where nothing is built. It may have more than the named."""
    import msgpack  # what every environment has; they are asked for their folder, which may be any on the path
    import numpy

    site = Path(numpy.__file__).parents[1]
    if Path(str(msgpack.__file__)).parents[1] != site:
        raise InputError(f"environment: expected numpy and msgpack in one folder, found numpy alone in {site}")
    return Environment("this Python", Path(sys.executable), site, ())


def build_environment(name: str, folder: Path, pip_options: Sequence[str] = ()) -> Environment:
    """Makes an environment with venv and the interpreter's own pip, wheels only; pip's settings name the index.

    It counts as built when all is there, and is not built over: boxes may be using it. Raises InputError.
    """
    made_of = find_recipe(name)
    target = folder / name
    if (target / ABOUT_FILE).exists():
        raise InputError(f"environment {name}: already built in {folder}; remove {target} to build it again")
    interpreter = f"python{made_of.python}"
    _run((interpreter, "-m", "venv", "--clear", "--without-pip", str(target)), name)
    python = target / "bin" / "python"
    pip = (interpreter, "-m", "pip", "--python", str(python), "--disable-pip-version-check", "--no-input")
    _run((*pip, "install", "--no-cache-dir", "--only-binary=:all:", *pip_options, *made_of.packages), name)
    packages = tuple(_run((*pip, "freeze", "--all"), name).split())
    site = target / "lib" / interpreter / "site-packages"
    return _write_description(Environment(name, python.absolute(), site.absolute(), packages), target)


def import_image(
    name: str, folder: Path, rootfs: Path, python: str = IMAGE_PYTHON, limits: BoxLimits | None = None
) -> Environment:
    """Notes an unpacked image as the environment. It is not copied: it must be at this path wherever boxes are opened.

    What it holds is asked in a box, because it may be a stranger's work. A newer image may replace an imported one,
    never one that was built here. Only in the main thread, as boxes want it. Raises InputError.
    """
    made_of = find_recipe(name)
    target = folder / name
    if (target / ABOUT_FILE).exists() and load_environment(name, folder).rootfs is None:
        raise InputError(f"environment {name}: built in {folder}; remove {target} to import an image in its place")
    limits = limits or BoxLimits()
    limits = replace(limits, memory_bytes=max(limits.memory_bytes, made_of.memory_bytes))
    version, *packages = _list_packages(
        name, BoxSpec((python, "-c", PROBE), {}, limits=limits, rootfs=rootfs.resolve())
    )
    if version != made_of.python:
        raise InputError(f"environment {name}: expected Python {made_of.python} in {rootfs}, found {version:.20}")
    if missing := [package for package in made_of.packages if package not in packages]:
        raise InputError(
            f"environment {name}: expected {', '.join(missing)} in {rootfs}, found {' '.join(packages):.300}"
        )
    target.mkdir(parents=True, exist_ok=True)
    made = Environment(name, Path(python), None, tuple(packages), rootfs.resolve(), _checksum_programs(rootfs))
    return _write_description(made, target)


def _checksum_programs(rootfs: Path) -> str:
    """Of names and sizes: contents would take minutes, and those of other programs hardly ever have all the same."""
    told = hashlib.sha256()
    for folder, folders, files in (found for part in PROGRAMS for found in os.walk(rootfs / part)):
        folders.sort()
        for file in sorted(files):
            path = Path(folder, file)
            told.update(os.fsencode(f"{path.relative_to(rootfs)}\0{path.lstat().st_size}\0"))
    return told.hexdigest()


def _list_packages(name: str, spec: BoxSpec) -> list[str]:
    """Major.minor of its interpreter, and its packages."""
    try:
        with open_box(spec) as box:
            box.ready(PROBE_S)
            report = box.close()
        told, failed = box.log().decode(errors="replace").split(), report.exit_code != 0
    except BoxError as error:  # also where the image has no such program
        told, failed = str(error).split(), True
    if failed or not told:
        said = " ".join(told)[-300:] or "nothing was said"
        raise InputError(f"environment {name}: {spec.command[0]} of {spec.rootfs} does not tell its packages: {said}")
    return told


def _write_description(made: Environment, target: Path) -> Environment:
    about = target / ABOUT_FILE
    partial = about.with_suffix(".partial")
    partial.write_text(json.dumps(asdict(made), default=str, indent=1), "utf-8")
    partial.replace(about)
    return made


def _run(command: tuple[str, ...], name: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=BUILD_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"environment {name}: {command[0]} cannot be run: {error}") from None
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing was said").splitlines()
        raise InputError(f"environment {name}: {' '.join(command[1:4])} failed: {said[-1]:.300}")
    return done.stdout

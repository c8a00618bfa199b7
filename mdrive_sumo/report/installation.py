"""Examine the installation: what is installed, and what is missing for which command."""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import GAPS, OWN_KERNEL, SHARED_KERNEL, KernelTrial, SandboxLayer
from mdrive_sumo.core import compiled
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.posix import REMEDY, is_posix
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.version import __version__

SIMULATOR_CHECK = "import libsumo; libsumo.getVersion()"
TIME_LIMIT_S = 30.0
"""[s] For a child process that loads SUMO or OpenGL: chosen: what takes longer hangs."""
SYSTEM_LIBRARIES = "libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1"
"""Debian packages that libsumo is linked against; desktops have them, servers and containers may not."""

PACKAGES = (
    ("numpy", "everything", ""),
    ("pydantic", "everything", ""),
    ("click", "everything", ""),
    ("msgpack", "eval, verify", ""),
    ("shapely", "eval, verify, rescore", ""),
    ("sumolib", "eval, verify, show, view", ""),
    ("matplotlib", "show", ""),
    ("eclipse-sumo", "convert, export openscenario", "convert"),
    ("commonroad-io", "convert commonroad, export commonroad", "export"),
    ("foxglove-sdk", "export mcap", "export"),
    ("pyarrow", "convert argoverse2, export parquet", "export"),
    ("scenariogeneration", "export openscenario", "export"),
    ("pycrate", "export pcap", "export"),
    ("fastapi", "serve", "server"),
    ("sqlalchemy", "serve, admin", "server"),
    ("pyseccomp", "serve, submit --dry-run", "server"),
    ("distributed", "--executor dask", "dask"),
    ("scipy", "generate --hard", "search"),
    ("moderngl", "agents with cameras, render --view chase or driver", "camera"),
    ("onnxruntime", "learned agents", "learned"),
    ("torch", "learn train, learn export", "learn"),
    ("onnx", "learn train, learn export", "learn"),
)
"""Distribution, the commands that need it, the extra that brings it ("" = the core install)."""


GL_REMEDY = f"{format_installation('camera')}; on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
RENDERER_CHECK = "from mdrive_sumo.sensing.camera.camera_renderer import load_renderer; print(load_renderer().driver)"


@dataclass(frozen=True, slots=True)
class InstallationCheck:
    """One requirement: what was found ("" = nothing), which commands need it, and how to install it."""

    name: str
    found: str
    needed_for: str
    remedy: str = ""
    is_required: bool = True
    """Whether the core commands need it."""

    @property
    def is_found(self) -> bool:
        """Whether the requirement is met."""
        return bool(self.found)


def examine_installation() -> tuple[InstallationCheck, ...]:
    """Examine this machine. SUMO's library is loaded in a child process, because a broken one may crash."""
    return (
        InstallationCheck("mdrive-sumo", __version__, "everything"),
        _python(),
        InstallationCheck("platform", _describe_platform(), "everything"),
        InstallationCheck("cores", str(count_usable_cores()), "eval --workers auto"),
        _compiled_layer(),
        *(_package(*row) for row in PACKAGES),
        _simulator(),
        _renderer(),
        _program("netconvert", "convert", format_installation("convert")),
        _program("bwrap", "serve, submit --dry-run", "on Debian and Ubuntu: apt-get install bubblewrap"),
        _program("ffmpeg", "render --out x.mp4", "on Debian and Ubuntu: apt-get install ffmpeg"),
    )


def _describe_platform() -> str:
    """Return system and processor, and on a system without POSIX what works there."""
    system = f"{platform.system()} {platform.machine()}"
    return system if is_posix() else f"{system}: built-in agents with one worker; all else {REMEDY}"


def count_usable_cores() -> int:
    """Cores that this process may use. (`suite` knows too, but needs packages that may be missing here.)"""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _python() -> InstallationCheck:
    python = platform.python_version() if sys.version_info >= (3, 11) else ""
    return InstallationCheck("python", python, "everything", "install Python 3.11 or newer")


def _compiled_layer() -> InstallationCheck:
    found = "" if compiled.USED_LAYER is None else f"of version {compiled.USED_LAYER.VERSION}"
    problem = compiled.PROBLEM or f"switched off by {compiled.SWITCH}=off"
    remedy = f"{problem}; results are the same; install mdrive-sumo anew"
    return InstallationCheck("compiled layer", found, "speed", remedy, is_required=False)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _package(name: str, needed_for: str, extra: str) -> InstallationCheck:
    remedy = format_installation(extra) if extra else f"pip install '{name}'"
    return InstallationCheck(name, _version(name), needed_for, remedy, is_required=not extra)


def _simulator() -> InstallationCheck:
    simulator, problem = "", "pip install libsumo"
    if _version("libsumo"):
        problem = _failure_of((sys.executable, "-c", SIMULATOR_CHECK))
        simulator = "" if problem else _version("libsumo")
        problem += f"; on Debian and Ubuntu: apt-get install {SYSTEM_LIBRARIES}"
    return InstallationCheck("libsumo", simulator, "eval, verify", problem)


def _renderer() -> InstallationCheck:
    """Find the OpenGL driver that cameras would use, in a child process: a broken driver may crash."""
    driver, problem = "", ""
    try:
        done = subprocess.run(
            (sys.executable, "-c", RENDERER_CHECK), capture_output=True, text=True, check=False, timeout=TIME_LIMIT_S
        )
        driver = done.stdout.strip() if done.returncode == 0 else ""
        problem = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    except (OSError, subprocess.TimeoutExpired) as error:
        problem = str(error)
    remedy = f"{problem.rpartition('InputError: ')[2]}; {GL_REMEDY}"
    return InstallationCheck(
        "OpenGL", driver, "agents with cameras, render --view chase or driver", remedy, is_required=False
    )


def _failure_of(command: Iterable[str]) -> str:
    """Return the last line that a failing command prints on standard error; "" if it succeeds."""
    try:
        done = subprocess.run(tuple(command), capture_output=True, text=True, check=False, timeout=TIME_LIMIT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]


def _program(name: str, needed_for: str, remedy: str) -> InstallationCheck:
    folder = Path(sys.executable).parent
    program = shutil.which(name, path=f"{folder}{os.pathsep}{os.environ.get('PATH', '')}") or ""
    return InstallationCheck(name, program, needed_for, remedy, is_required=False)


def format_installation_table(checks: Iterable[InstallationCheck]) -> str:
    """Return the checks as a table for the terminal, followed by what is missing."""
    checks = tuple(checks)
    rows = [(check.name, check.found or "missing", check.needed_for) for check in checks]
    missing = [check for check in checks if not check.is_found]
    return "\n".join(
        (
            format_text(make_text_table(("what", "found", "needed for"), rows)),
            "",
            *(f"missing for {check.needed_for}: {check.name} ({check.remedy})" for check in missing),
            *(() if missing else ("Nothing is missing.",)),
        )
    )


def format_sandbox_table(layers: Iterable[SandboxLayer], backend: str, trial: KernelTrial) -> str:
    """Return the default backend, its layers on this machine as a table, and what it and the fallback leave open.

    backend: the one that a server takes here with `[sandbox] backend = "auto"`. trial: whether boxes can have a kernel
    each.
    """
    rows = [(layer.name, "in force" if layer.active else "absent", layer.detail) for layer in layers]
    fallback = GAPS[SHARED_KERNEL]
    return "\n".join(
        (
            *_describe_default(backend, trial),
            "",
            format_text(make_text_table(("layer", "here", "how"), rows)),
            "",
            f"The backend {backend} does not protect from:",
            *(f"  - {gap}" for gap in GAPS[backend]),
            *(("", f"The fallback {SHARED_KERNEL} would not protect from:") if backend == OWN_KERNEL else ()),
            *((f"  - {gap}" for gap in fallback) if backend == OWN_KERNEL else ()),
        )
    )


def _describe_default(backend: str, trial: KernelTrial) -> tuple[str, ...]:
    """Return lines about the default of a server on this machine."""
    if backend == OWN_KERNEL:
        return (f"default backend: {backend}, a kernel for each box ({trial.detail})", f"fallback: {SHARED_KERNEL}")
    return (
        f"default backend: {backend}, the fallback, whose boxes share the host's kernel: {trial.detail}",
        "Hidden phases are refused here unless the server's settings say [sandbox] hidden_on_shared_kernel = true.",
    )

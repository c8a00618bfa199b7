"""Build the compiled layer: C files beside the Python files whose twins they are, one extension module for all.

hatchling calls `CompiledLayer` for every installation. `python hatch_build.py` builds the layer of a clone anew, after
a change of a C file. The compiler is the package `ziglang`, so nothing but Python has to be installed. Where it cannot
build, the installation has no layer: the same results, several times slower (docs/decisions/075).
"""

import os
import platform
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent
LAYER = Path("mdrive_sumo/core/compiled/layer.abi3.so")
"""Relative to the root of the project, and of a wheel."""
CACHE = Path("build/ziglang")
"""Of the compiler, in a clone."""
FLAGS = (
    *("-std=c23", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror"),
    *("-Wno-unused-parameter", "-Wno-bitwise-op-parentheses"),
    # Bits decide: no fused multiply-add, and nothing that reorders sums. (-ffast-math is off unless it is asked for.)
    *("-ffp-contract=off", "-fno-sanitize=all", "-g0"),
)
TARGETS = {"x86_64": "x86_64-linux-gnu.2.17", "aarch64": "aarch64-linux-gnu.2.17"}
"""Machine -> what the compiler builds for: the least of its processors, and glibc 2.17 as of manylinux2014."""


def describe_sources(root: Path) -> tuple[list[str], str]:
    """Return the files that the layer is built from, relative to the root, and their digest."""
    # Run, not imported: what the package needs is not installed where a wheel is built.
    sources = runpy.run_path(str(ROOT / "mdrive_sumo/core/compiled/sources.py"))
    files: list[str] = sources["list_sources"](root)
    return files, sources["digest_sources"](root, files)


def compile_layer(root: Path, version: str, out: Path, cache: Path) -> None:
    """Compile the layer; the compiler keeps its work in `cache`.

    Raises OSError, or subprocess.CalledProcessError with the compiler's words as `stderr`.
    """
    machine = platform.machine()
    if sys.platform != "linux" or machine not in TARGETS:
        raise OSError(f"expected Linux on one of {', '.join(TARGETS)}, found {sys.platform} on {machine}")
    files, digest = describe_sources(root)
    constants = {"VERSION": version, "SOURCES": digest, "FILES": " ".join(files)}
    names = [f'-DMDRIVE_{name}="{text}"' for name, text in constants.items()]
    sources = [str(root / file) for file in files if file.endswith(".c")]
    target = ("-target", TARGETS[machine], "-mcpu=baseline")
    fresh = out.with_suffix(".new")  # replaced at once: processes may be running with the old one
    command = (sys.executable, "-m", "ziglang", "cc", *target, *FLAGS, *names, "-o", str(fresh), *sources, "-lm")
    # Where it would keep its work by itself is in a home, which there may be none of.
    environment = {"ZIG_GLOBAL_CACHE_DIR": str(cache), **os.environ}
    subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    fresh.replace(out)


def read_version(root: Path) -> str:
    """Return the version of the project, which has one line of its own."""
    return (root / "mdrive_sumo/core/version.py").read_text().rpartition('= "')[2].strip().rstrip('"')


def main() -> None:
    """Build the layer of this clone."""
    try:
        compile_layer(ROOT, read_version(ROOT), ROOT / LAYER, ROOT / CACHE)
    except subprocess.CalledProcessError as error:
        sys.exit(error.stderr)


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # `python hatch_build.py` needs no hatchling
    BuildHookInterface = object


class CompiledLayer(BuildHookInterface):  # type: ignore[misc]
    """Adds the layer to a wheel; an editable installation has it in the clone."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, or say in one line why that was impossible. version: "editable" or "standard"."""
        root, self._scratch = Path(self.root), Path(tempfile.mkdtemp())
        out, cache = self._scratch / LAYER.name, self._scratch / "cache"
        if version == "editable":
            out, cache = root / LAYER, root / CACHE
        try:
            compile_layer(root, read_version(root), out, cache)
        except (OSError, subprocess.CalledProcessError) as error:
            words = (getattr(error, "stderr", None) or str(error)).strip().splitlines() or ["no reason given"]
            self.app.display_warning(f"mdrive-sumo: no compiled layer, same results but slower: {words[-1]}")
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-manylinux_2_17_{platform.machine()}"
        if version != "editable":
            build_data["force_include"][str(out)] = LAYER.as_posix()

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002 (hatchling)
        """Remove what the wheel has a copy of."""
        shutil.rmtree(self._scratch)


if __name__ == "__main__":
    main()

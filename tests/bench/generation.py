"""The figures of issue D's generation: ten scenarios of every category by `mdrive-sumo generate`, each on one core.

Run it alone: python tests/bench/generation.py [CATEGORY...]
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from mdrive_sumo.generate.category_requirements import Category

Row = tuple[str, float, str, str]
COUNT = 10
LIMIT_S = 60


def generation_rows(folder: Path, categories: Sequence[str] = tuple(Category)) -> Iterator[Row]:
    """Wall and processor time of the whole command, start of Python included, and proposals per scenario."""
    for category in categories:
        cpu, began = _children_s(), time.perf_counter()
        done = subprocess.run(
            (
                *(sys.executable, "-c", "from mdrive_sumo.cli import main; main()", "generate", "--explain"),
                *("--category", category, "--count", str(COUNT), "--out", folder / category),
            ),
            preexec_fn=lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}),
            check=False,
            capture_output=True,
            text=True,
        )
        wall, proposals = time.perf_counter() - began, done.stdout.count("\nproposal ") + 1
        made = sum(path.is_dir() for path in (folder / category).glob("*")) if done.returncode < 2 else 0
        yield f"generate {category}, scenarios of {COUNT}", made, "", f"= {COUNT}"
        yield f"generate {category}, proposals", proposals, "", "-"
        yield f"generate {category}, wall", wall, "s", f"< {LIMIT_S}"
        yield f"generate {category}, processor", _children_s() - cpu, "s", "-"


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for row in generation_rows(Path(scratch), sys.argv[1:] or tuple(Category)):
            sys.stdout.write(f"{row[0]:<66}{row[1]:>10.2f} {row[2]:<8}{row[3]}\n")
            sys.stdout.flush()

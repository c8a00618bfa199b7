"""Feeds one reader with damaged files for some seconds: `python -m testing.fuzz_process TARGET SECONDS SEED FOLDER`.

With atheris, an optional tool that is not in the lock (`pip install atheris`), libFuzzer keeps inputs that reach new
code and changes them further. Without it, inputs that end in a new way are kept: another refusal, from another line.
Ends with the exit code 0, or with another one and the input in FOLDER/finding.
`python -m testing.fuzz_process TARGET FILE` reads one input again.
"""

import importlib
import importlib.util
import os
import random
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

MEMORY_BYTES = 5 * 2**30
CPU_EACH_S = 20
"""[s] Processor time for one input; the slowest takes 0.1 s."""
MAX_CORPUS = 200


class Harness:
    """Writes inputs over the valid file of a target and reads them; anything but a refusal is a finding."""

    def __init__(self, name: str, folder: Path, limited: bool = False) -> None:
        from testing.fuzz_targets import TARGETS

        self._target, self._folder, self._limited, self.inputs = TARGETS[name], folder, limited, 0
        self._work = Path(tempfile.mkdtemp(prefix="valid-", dir=folder))
        self._path = self._target.write(self._work)
        self.valid = self._path.read_bytes()
        self.feed(self.valid)

    def feed(self, data: bytes) -> tuple[str, int]:
        """Read an input and return how it ended; it is written as a finding first, so that a crash leaves it behind."""
        self.inputs += 1
        if self._limited:
            _allow_cpu(CPU_EACH_S)
        (self._folder / "finding").write_bytes(data)
        self._path.write_bytes(data)
        try:
            self._target.read(self._path)
        except self._target.refusals as error:
            if "\n" in str(error):
                raise AssertionError(f"a refusal of several lines: {error}") from None
            return _describe_end(error)
        return "read", 0


def _describe_end(error: Exception) -> tuple[str, int]:
    """Return the place of a refusal and the number of words in it."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = "" if trace is None else f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
    return where, len(str(error).split())


def _allow_cpu(seconds: int) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + seconds
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))


def main(arguments: list[str]) -> None:
    """Run the command line."""
    name, *rest = arguments
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    if len(rest) == 1:
        with tempfile.TemporaryDirectory() as folder:
            Harness(name, Path(folder), limited=True).feed(Path(rest[0]).read_bytes())
        return
    folder = Path(rest[2]).resolve()
    run = _run_atheris if importlib.util.find_spec("atheris") else _run_damage
    run(name, float(rest[0]), int(rest[1]), folder)


def _run_damage(name: str, seconds: float, seed: int, folder: Path) -> None:
    """Damage the valid file, and inputs that ended in a new way, until the time is over."""
    harness, draws = Harness(name, folder, limited=True), random.Random(f"{name} {seed}")
    from testing.fuzz_damage import damage

    corpus, ends, stop = [harness.valid], set[tuple[str, int]](), time.monotonic() + seconds
    while time.monotonic() < stop:
        data = damage(draws.choice(corpus), draws)
        end = harness.feed(data)
        if end not in ends and len(corpus) < MAX_CORPUS:
            ends.add(end)
            corpus.append(data)
    (folder / "finding").unlink()
    sys.stdout.write(f"{harness.inputs} inputs, {len(ends)} ends\n")


def _run_atheris(name: str, seconds: float, seed: int, folder: Path) -> None:
    """Let libFuzzer choose inputs by the code that they reach. It ends the process itself, after a finding with 77."""
    atheris: Any = importlib.import_module("atheris")
    with atheris.instrument_imports(include=["real2sim", "mdrive_sumo", "server"]):
        harness = Harness(name, folder, limited=True)
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    (corpus / "valid").write_bytes(harness.valid)
    options = [f"-max_total_time={seconds:.0f}", f"-seed={seed + 1}", "-rss_limit_mb=0", "-max_len=65536"]
    os.chdir(folder)  # libFuzzer writes its own copy of a finding where it runs

    def feed(data: bytes) -> None:
        harness.feed(data)

    atheris.Setup(["fuzz", *options, str(corpus)], feed)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])

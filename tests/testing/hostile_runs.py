"""What a stranger does to a run folder: hostile values, signed like honest ones, and files that are none. No tests."""

import json
import os
import random
import shutil
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.runs import journal as journals

ESCAPE = "\x1b]0;owned\x07\x1b[2J"
BIDI = "\u202egnp.\u2066exe"
FORMULA = '=HYPERLINK("http://evil.example/";"x")'
IMAGE = "![x](http://evil.example/x.png)"
MARKUP = '</script><script>alert(1)</script><img src=x onerror="alert(1)">'
KEY = "\nssh-ed25519 AAAAevil attacker\n"
WORDS = (
    "", "x" * 5000, ESCAPE, BIDI, FORMULA, IMAGE, MARKUP, KEY, "a\nb", "\0", "\ud800", "../../outside/owned",
    "/dev/zero", "os:system", "@SUM(1)", "nan", "é" * 300, "\u2028", "s0", "-", "`|`", "\\](http://evil.example)",
)  # fmt: skip
NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2**31, 2**63, -(2**63), 10**400, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -0.0, 10**18, 0.5,
)  # fmt: skip
OTHERS: tuple[Any, ...] = (None, True, [], {}, [[]], {"": 0}, ["x"])


def _list_leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (container, key) of everything in a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in [*items]:
        yield value, key
        yield from _list_leaves(inner)


def _change_value(data: Any, draws: random.Random) -> None:
    """Change one value of a JSON value, mostly into one of its own type."""
    container, key = draws.choice([*_list_leaves(data)])
    old = container[key]
    if draws.random() < 0.15:
        container[key] = draws.choice(OTHERS)
    elif isinstance(container, dict) and draws.random() < 0.1:
        container[draws.choice(WORDS)] = container.pop(key)
    elif isinstance(old, str):
        container[key] = draws.choice(WORDS)
    elif isinstance(old, int | float):
        container[key] = draws.choice(NUMBERS)
    elif isinstance(old, list) and old and draws.random() < 0.5:
        old.append(old[0])
    else:
        container[key] = draws.choice((draws.choice(WORDS), draws.choice(NUMBERS)))


def change_results(run: Path, draws: random.Random) -> None:
    """Change a value of results.json."""
    path = run / "results.json"
    data = json.loads(path.read_text())
    _change_value(data, draws)
    path.write_text(json.dumps(data))


def read_lines(run: Path) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
    for line in lines:
        line.pop("checksum", None)
    return lines


def sign(run: Path, lines: list[dict[str, Any]]) -> None:
    """Write a journal with checksums that fit."""
    checksum, text = "", ""
    for line in lines:
        body = json.dumps(line, separators=(",", ":"))
        checksum = journals._compute_checksum(checksum, body.encode())
        text += f'{body[:-1]},"checksum":"{checksum}"}}\n'
    (run / "journal.jsonl").write_text(text)


def change_journal(run: Path, draws: random.Random) -> None:
    """Change a value of the journal, and sign it."""
    lines = read_lines(run)
    _change_value(draws.choice(lines[:1] if draws.random() < 0.5 else lines), draws)
    sign(run, lines)


def change_everywhere(run: Path, draws: random.Random) -> None:
    """Change one word in results and journal alike."""
    data, lines = json.loads((run / "results.json").read_text()), read_lines(run)
    words = sorted({c[k] for c, k in _list_leaves(data) if isinstance(c[k], str)})
    old, new = draws.choice((*words, *("stationary", "tiny", "deed", "Tiny") * 3)), draws.choice(WORDS)
    for container, key in (*_list_leaves(data), *_list_leaves(lines)):
        if isinstance(container[key], str) and container[key] == old:
            container[key] = new
    (run / "results.json").write_text(json.dumps(data))
    sign(run, lines)


def _rewrite_recording(run: Path, scenario: str, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the arrays of a recording, and sign it in the journal."""
    path = run / "episodes" / f"{scenario}.npz"
    with np.load(path) as archive:
        arrays = {name: archive[name].copy() for name in archive.files}
    change(arrays)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)
    lines = read_lines(run)
    for line in lines[1:]:
        if line.get("result", {}).get("id") == scenario:
            line["recording"] = "sha256:" + sha256(path.read_bytes()).hexdigest()
    sign(run, lines)


def change_arrays(run: Path, scenario: str, change: Callable[[dict[str, Any]], object]) -> None:
    """Change arrays of a recording in their place, and sign it."""
    _rewrite_recording(run, scenario, lambda arrays: (change(arrays), None)[1])


def change_header(run: Path, scenario: str, change: Callable[[str], str]) -> None:
    """Change the header of a recording as text, and sign it."""

    def apply(arrays: dict[str, Any]) -> None:
        text = change(arrays["header"].tobytes().decode())
        arrays["header"] = np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)

    _rewrite_recording(run, scenario, apply)


def change_recording(run: Path, draws: random.Random) -> None:
    """Change a value in the header, or an array, of a recording, and sign it."""
    scenario = draws.choice(sorted(path.stem for path in (run / "episodes").glob("*.npz")))

    def change_text(text: str) -> str:
        header = json.loads(text)
        _change_value(header, draws)
        return json.dumps(header)

    def change_numbers(arrays: dict[str, Any]) -> None:
        name = draws.choice(sorted(set(arrays) - {"header"}))
        found = arrays[name]
        info = np.iinfo(found.dtype) if found.dtype.kind in "iu" else None
        if found.size:
            extremes = (info.min, info.max, 0) if info else (np.nan, np.inf, -np.inf, 3.4e38, 0.0, -1.0)
            found.flat[draws.randrange(found.size)] = draws.choice(extremes)
        if name == "quanta" and draws.random() < 0.5:
            arrays[name] = np.full(found.shape, draws.choice((2**31 - 1, -(2**31), 10**6)), np.int32)

    if draws.random() < 0.6:
        change_header(run, scenario, change_text)
    else:
        _rewrite_recording(run, scenario, change_numbers)


NAMES = (
    "results.json", "journal.jsonl", "report.md", "episodes", "episodes/s0.npz", "view", "view/index.html", "logs",
    "view/s0.html", "results-mdrive.json", "results-mdrive.tmp", "results.tmp", "transcript.jsonl", "transcripts",
    "cameras", "calls", "view/with-other",
)  # fmt: skip


def replace_file(run: Path, draws: random.Random) -> None:
    """Put a link, a device, a pipe, a folder, or a file without end in place of a file or a folder."""
    path = run / draws.choice(NAMES)
    if path.parent != run:
        path.parent.mkdir(exist_ok=True)
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.is_dir():
        shutil.rmtree(path)
    outside = run.parent / "outside"
    kinds: tuple[Callable[[], object], ...] = (
        lambda: path.symlink_to("/dev/zero"),
        lambda: path.symlink_to(outside / "keys"),
        lambda: path.symlink_to(outside),
        lambda: path.symlink_to(outside / "new"),
        lambda: path.symlink_to(path.name),
        lambda: os.mkfifo(path),
        lambda: path.mkdir(),
        lambda: path.write_bytes(b""),
        lambda: _make_sparse(path),
    )
    draws.choice(kinds)()


def _make_sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**36)


CHANGES = (change_results, change_journal, change_everywhere, change_everywhere, change_recording, replace_file)

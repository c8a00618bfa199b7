"""Damage to the bytes of valid files, drawn from a seed."""

import random

TOKENS = (
    b"", b"\x00", b"\xff\xff\xff\xff", b"\x7f", b"-1", b"0", b"1e308", b"1e999", b"nan", b"99999999999999999999",
    b"1" * 400, b"-" + b"9" * 400, b"1" * 5000, b"-1e308", b"1e-320", b"9007199254740993", b"NaN", b"-Infinity",
    b"null", b"true", b"{}", b"[]", b'""', b"\xc3\x28", b"<a>", b"'", b'"', b"<!DOCTYPE a>", b"\n", b" ", b"x" * 5000,
    b"\x1b[2J", b"\\u001b[2J", "\u202e".encode(), b"\\ud800", b'=HYPERLINK("x")', b"![x](http://x)", b"\\n", b"a\nb",
    b"[" * 5000, b"<a>" * 5000, b'{"a":' * 3000,
)  # fmt: skip
"""What readers meet in damaged files: extremes, other types, bytes that are no text, nesting without end."""
NUMBERS = tuple(token for token in TOKENS if token[:1] and token[:1] in b"-0123456789n" and token != b"null")
"""Of these, what can stand for a number."""
MAX_EDITS = 4
MAX_SPAN = 40
MAX_GROWTH = 20_000
"""Bytes that an input has more than the valid file at most."""


def damage(data: bytes, draws: random.Random) -> bytes:
    """Return the bytes after one to four edits: a token, a deletion, a repetition, a flipped byte, a cut."""
    limit = len(data) + MAX_GROWTH
    for _ in range(draws.randint(1, MAX_EDITS)):
        data = _edit(data, draws)[:limit]
    return data


def _edit(data: bytes, draws: random.Random) -> bytes:
    start = draws.randrange(len(data) + 1)
    end = start + draws.randint(0, MAX_SPAN if draws.random() < 0.9 else len(data))
    kind = draws.randrange(9)
    if kind < 3:
        token = draws.choice(TOKENS)
        return data[:start] + token + data[start + (len(token) if kind == 0 else 0) :]
    if kind < 5:
        return data[:start] + bytes((draws.randrange(256),)) + data[start + 1 :]
    if kind == 5:
        return data[:start] + data[end:]
    if kind == 6:
        return data[:end] + data[start:]
    if kind == 7:
        other = draws.randrange(len(data) + 1)
        return data[:start] + data[other : other + end - start] + data[end:]
    return data[:start] if draws.random() < 0.3 else _replace_number(data, draws)


def _replace_number(data: bytes, draws: random.Random) -> bytes:
    """Replace a run of digits, as in text formats."""
    places = [at for at in range(len(data)) if data[at : at + 1].isdigit() and not data[at - 1 : at].isdigit()]
    if not places:
        return data
    start = end = draws.choice(places)
    while data[end : end + 1].isdigit():
        end += 1
    return data[:start] + draws.choice(NUMBERS) + data[end:]

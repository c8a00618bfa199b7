"""Sentences about a name that does not exist: the names that do, and the one that was probably meant."""

from collections.abc import Iterable

from mdrive_sumo.core.clean_text import truncate

LEAST_SIMILARITY = 0.6
"""Similarity in [0, 1] of two names that may be the same one mistyped: the default of `difflib`."""


def suggest_name(name: str, names: Iterable[str]) -> str:
    """Return "; did you mean 'idm'?" for the known name most similar to another, upper and lower case being alike.

    Returns "" if none is similar.
    """
    from difflib import get_close_matches  # only here: every agent's process imports this module

    by_text = {one.casefold(): one for one in names}
    close = get_close_matches(name.casefold(), by_text, n=1, cutoff=LEAST_SIMILARITY)
    return f"; did you mean {by_text[close[0]]!r}?" if close else ""


def describe_unknown(name: str, known: Iterable[str], also: str = "") -> str:
    """Return "expected one of a, b, found 'c'; did you mean 'a'?".

    also: what else would do, such as "or a folder"; "": nothing.
    """
    names = tuple(known)
    expected = f"{', '.join(names)}{f' {also}' if also else ''}"
    return f"expected one of {expected}, found {shorten_name(name)}{suggest_name(name, names)}"


def shorten_name(name: str, max_length: int = 60) -> str:
    """Return a name in quotes, cut to a length."""
    return repr(truncate(name, max_length))

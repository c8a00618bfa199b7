"""Build the containers of Python's library that pickles name as classes, as plain dicts and sets.

MetaDrive's writer leaves a `defaultdict(int)` in `metadata.number_summary` of every description; pickles of protocol 3
and older name the class of every set, and those of protocol 2 and older carry bytes as text.
"""

from typing import Any

from real2sim.readers.pickled_arrays import Constructor


class _Factory(Constructor):
    """Stands for a type that is the default of a `defaultdict`; a pickle cannot call it."""

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__(_refuse_call)


def _refuse_call(*_: object) -> None:
    raise ValueError("expected a type as the default of a dict only, found a call of it")


def _build_default_dict(factory: object = None, items: Any = ()) -> dict[Any, Any]:
    if factory is not None and not isinstance(factory, _Factory):
        raise ValueError("expected a type of numbers, text or containers as the default of a dict")
    return _build_dict(items)


def _build_dict(items: Any = ()) -> dict[Any, Any]:
    if not isinstance(items, dict | list | tuple):
        raise ValueError("expected the items of a dict")
    return dict(items)


def _build_set(items: Any = ()) -> set[Any]:
    if not isinstance(items, list | tuple):
        raise ValueError("expected the items of a set")
    return set(items)


def _build_frozenset(items: Any = ()) -> frozenset[Any]:
    return frozenset(_build_set(items))


def _encode(text: Any, encoding: Any = "") -> bytes:
    if not isinstance(text, str) or encoding != "latin1":
        raise ValueError("expected bytes as text of latin1")
    return text.encode("latin-1")


def _build_bytes() -> bytes:
    return b""


FACTORY_NAMES = ("int", "float", "bool", "str", "list", "dict")
"""Types that count as the default of a dict; a set is named for itself as well."""
_BUILTINS = ("builtins", "__builtin__")
"""Python 3's name of the module, and that of protocol 2 and older."""

CONTAINERS: dict[tuple[str, str], object] = {
    ("collections", "defaultdict"): Constructor(_build_default_dict),
    ("collections", "OrderedDict"): Constructor(_build_dict),
    ("collections", "Counter"): Constructor(_build_dict),
    ("_codecs", "encode"): Constructor(_encode),
    **{(module, name): _Factory() for module in _BUILTINS for name in (*FACTORY_NAMES, "long")},
    **{(module, "set"): Constructor(_build_set) for module in _BUILTINS},
    **{(module, "frozenset"): Constructor(_build_frozenset) for module in _BUILTINS},
    **{(module, "bytes"): Constructor(_build_bytes) for module in _BUILTINS},
    ("metadrive.scenario.scenario_description", "ScenarioDescription"): dict,  # of to_dict=False: a dict with constants
}
"""(module, name) in a pickle -> its constructor."""

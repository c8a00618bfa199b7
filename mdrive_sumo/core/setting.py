"""Setting: what a field of a settings class says of itself; options, arguments, files and reports derive from it.

`RunConfig` is the settings class of a run; it contains those of an episode, an agent and the other agents. Decision 072
says what derives from a field.
"""

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from enum import StrEnum
from functools import cache
from inspect import Parameter, signature
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypedDict, Unpack, get_args, get_origin, get_type_hints

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown

Scalar = str | int | float | bool
"""What journals and results hold of a setting."""
_METADATA = "setting"
_SCALARS = (str, bool, int, float)
_LARGEST = sys.float_info.max
"""Largest number of a setting without bounds: files hold no infinite ones."""
_WORDS: Mapping[type, str] = {
    **{str: "a text", bool: "True or False", int: "a whole number", float: "a number"},
    Path: "a path",
}


class SettingFacts(TypedDict, total=False):
    """What a field may say of itself; see `Setting`."""

    help: str
    key: str
    option: str
    metavar: str
    unit: str
    bounds: tuple[float, float | None]
    typed: str | int
    absent: Scalar
    hides_default: bool
    is_identity: bool


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a settings class."""

    help: str = ""
    """Text of its option on the command line."""
    key: str = ""
    """Its name as an argument of Python and in journals, results and reports; by default that of the field."""
    option: str = ""
    """Its option on the command line; by default `--KEY`, and `--no-KEY` for what is on unless it is switched off."""
    metavar: str = ""
    """Placeholder of the value in help texts; by default the unit."""
    unit: str = ""
    """Unit of a number."""
    bounds: tuple[float, float | None] | None = None
    """Least and largest number; None as the second: no largest; None: any."""
    typed: str | int | None = None
    """The default as a user types it, of a setting whose value is no scalar."""
    absent: Scalar | None = None
    """What results from before the setting are read as; "": unknown; None: the default."""
    hides_default: bool = False
    """Whether files and reports leave out its default. A setting that came later has it, so that runs of the behaviour
    before it keep their identity and their files."""
    is_identity: bool = True
    """Whether runs that differ in it are different runs. Settings of how a run is executed are not part of it."""
    owner: type = NoneType
    """The class that has the field. This and the following are read from the class."""
    field: str = ""
    """Name of the field."""
    kind: Any = str
    """Type of the value without None."""
    default: Any = None

    @property
    def label(self) -> str:
        """Its name in reports: "agent clock"."""
        return self.key.replace("_", " ")

    @property
    def is_choice(self) -> bool:
        """Whether it has a fixed set of values."""
        return isinstance(self.kind, type) and issubclass(self.kind, StrEnum)

    @property
    def is_scalar(self) -> bool:
        """Whether it is a choice, a number, a text or a flag, so that all else follows from its type."""
        return self.is_choice or self.kind in _SCALARS

    @property
    def stored_kind(self) -> type:
        """Type of the value in files."""
        return str if self.is_choice else self.kind

    @property
    def typed_default(self) -> Scalar | None:
        """The default as a user types it; None: nothing."""
        if self.typed is not None or not self.is_scalar or self.default is None:
            return self.typed
        return self.write(self.default)

    def is_hidden(self, value: Any) -> bool:
        """Return whether files and reports leave out this value, in the setting's type or as files hold it."""
        return self.hides_default and value == self.default

    def write(self, value: Any) -> Scalar:
        """Return the value of a scalar setting as files hold it."""
        return str(value) if self.is_choice else value

    def read(self, stored: object) -> Any:
        """Return the value of a scalar setting that a file holds. Raises TypeError and ValueError for a corrupt one."""
        if type(stored) is not self.stored_kind:
            raise TypeError(f"{self.key}: expected a value of type {self.stored_kind.__name__}, found {stored!r:.60}")
        return self.kind(stored)

    def parse(self, value: Any) -> Any:
        """Return the value that a user gives, a text or one of the setting's type. Raises InputError."""
        if value is None and self.default is None:
            return None
        if self.is_choice:
            if not isinstance(value, str) or value not in list(self.kind):
                raise InputError(f"{self.key}: {describe_unknown(str(value), [str(choice) for choice in self.kind])}")
            return self.kind(value)
        if self.kind is Path and isinstance(value, str | Path):
            return Path(value)
        if self.kind in (int, float):
            return self._parse_number(value)
        if self.kind is bool and isinstance(value, np.bool_):
            return bool(value)
        if not isinstance(value, self.kind):
            raise InputError(f"{self.key}: expected {_WORDS[self.kind]}, found {value!r:.40}")
        return value

    def _parse_number(self, value: Any) -> float:
        """Return a number of Python or NumPy. Raises InputError."""
        low, high = self.bounds or (-_LARGEST, None)
        numbers: type = Integral if self.kind is int else Real
        is_number = isinstance(value, numbers) and not isinstance(value, bool)
        if not is_number or not low <= value <= (_LARGEST if high is None else high):
            limits = "" if not self.bounds else f" from {low:g}" + ("" if high is None else f" to {high:g}")
            unit = f" [{self.unit}]" if self.unit else ""
            raise InputError(f"{self.key}: expected {_WORDS[self.kind]}{limits}{unit}, found {value!r:.40}")
        return self.kind(value)

    def name_value(self, value: Any) -> str:
        """Return what a scalar setting adds to the name of a run's folder: "weather-friction"; "" for the default."""
        if value == self.default:
            return ""
        if self.kind is bool:
            return self.key if value else f"no{self.key}"
        return f"{value}-{self.key}"


def setting(default: Any = MISSING, *, factory: Any = MISSING, **facts: Unpack[SettingFacts]) -> Any:
    """Return the dataclass field of a setting. factory: makes the default, as of `dataclasses.field`."""
    return field(default=default, default_factory=factory, metadata={_METADATA: Setting(**facts)})


@cache
def list_settings(settings_class: type) -> tuple[Setting, ...]:
    """Return the settings of a class in the order of its fields, with those of fields that are settings classes."""
    kinds = get_type_hints(settings_class)
    found: list[Setting] = []
    for item in fields(settings_class):
        kind = _drop_none(kinds[item.name])
        declared: Setting | None = item.metadata.get(_METADATA)
        if declared is not None:
            default = item.default if item.default_factory is MISSING else item.default_factory()
            found.append(
                replace(
                    declared,
                    key=declared.key or item.name,
                    owner=settings_class,
                    field=item.name,
                    kind=kind,
                    default=None if default is MISSING else default,
                )
            )
        elif is_dataclass(kind) and any(_METADATA in inner.metadata for inner in fields(kind)):
            found += list_settings(kind)
    return tuple(found)


def check_names(names: Iterable[str], known: Iterable[str]) -> None:
    """Raise InputError for the first name of an argument that is not one of the known ones."""
    expected = tuple(known)
    for name in names:
        if name not in expected:
            raise InputError(f"{name}: unknown option, {describe_unknown(name, expected)}")


def check_arguments(function: Callable[..., Any], given: Iterable[str], settings_class: type) -> None:
    """Raise InputError for a name that is neither a parameter of a function nor a setting of a class."""
    own = [one.name for one in signature(function).parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    check_names(given, dict.fromkeys([*own, *(one.key for one in list_settings(settings_class))]))


def _drop_none(kind: Any) -> Any:
    """Return the type of a value that may also be None; other unions stay."""
    if get_origin(kind) is not UnionType:
        return kind
    others = [part for part in get_args(kind) if part is not NoneType]
    return others[0] if len(others) == 1 else kind

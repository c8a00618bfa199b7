"""ImportedFunction: a function for worker processes whose module the owner of the workers does not import."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Generic, TypeVar

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True)
class ImportedFunction(Generic[J, R]):
    """A top-level function by name; it is imported where a pickle of it is read, or where it is called."""

    module: str
    name: str

    def __call__(self, job: J) -> R:
        """Import and call the function."""
        return import_function(self.module, self.name)(job)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, str]]:
        """Be read from a pickle as the function itself: a fork server imports it once for all its workers."""
        return import_function, (self.module, self.name)


def import_function(module: str, name: str) -> Callable[[Any], Any]:
    """Return a function of a module, which is imported."""
    return getattr(import_module(module), name)

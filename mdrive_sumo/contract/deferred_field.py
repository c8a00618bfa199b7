"""DeferredField: a field of a frozen dataclass that is computed when it is first read."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar


class DeferredField:
    """Base of a frozen dataclass with slots whose field `DEFERRED` may be computed when it is first read.

    What is read must not depend on when it is read. Copies, comparisons and messages to other processes read it.
    """

    __slots__ = ("_compute_field",)
    DEFERRED: ClassVar[str]
    """Name of the field."""

    if not TYPE_CHECKING:  # a type checker would take every misspelt field for one that exists

        def __getattr__(self, name: str) -> Any:
            """Python calls this for fields without a value."""
            if name != self.DEFERRED:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            value = self._compute_field()
            object.__setattr__(self, name, value)
            object.__delattr__(self, "_compute_field")
            return value

    def defer(self, compute: Callable[[], Any]) -> None:
        """Let `compute` return the field when it is first read. Only for the builder of the instance."""
        object.__setattr__(self, "_compute_field", compute)
        object.__delattr__(self, self.DEFERRED)

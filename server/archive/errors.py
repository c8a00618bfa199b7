"""The error for archives that are refused."""

from mdrive_sumo.core.errors import InputError


class ArchiveRefused(InputError):
    """The archive or what its agent requires is refused; the sentence is for its team."""

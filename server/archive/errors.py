"""What is wrong with an archive, in one sentence for who sent it."""

from mdrive_sumo.core.errors import InputError


class ArchiveRefused(InputError):
    """The archive or what it asks for is refused; nothing of it was run."""

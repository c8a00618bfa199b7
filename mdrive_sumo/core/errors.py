"""The two ways in which something outside this code base may be wrong."""


class InputError(Exception):
    """Unusable input. The text is one sentence for the user: what, where, expected, found. Exit code 2."""


class WorldError(Exception):
    """The simulator did something that makes the episode worthless; the episode becomes void."""

"""The exceptions that a user of the library may catch. `loop.agent_driver.AgentFailure` completes the hierarchy."""


class MdriveError(Exception):
    """Base class of every error that mdrive-sumo raises on purpose."""


class InputError(MdriveError):
    """Unusable input. The text is one sentence for the user: what, where, expected, found. Exit code 2."""

    def __init__(self, text: str = "") -> None:
        """text: may quote a stranger's file; line breaks and characters of control in it are shown as escapes."""
        from mdrive_sumo.core.clean_text import clean_line  # boxes load this module and never that one

        super().__init__(clean_line(text))


class WorldError(MdriveError):
    """The simulator failed, which makes the episode worthless; the episode becomes void."""

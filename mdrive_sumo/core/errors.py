"""The exceptions that a user of the library may catch. `loop.agent_driver.AgentFailure` completes the hierarchy."""


class MdriveError(Exception):
    """Base class of every error that mdrive-sumo raises on purpose."""


class InputError(MdriveError):
    """Unusable input. The text is one sentence for the user: what, where, expected, found. Exit code 2.

    Several sentences, one for each unusable input of a batch, are several arguments; as text they are lines.
    """

    def __str__(self) -> str:
        """Return the sentences."""
        return "\n".join(map(str, self.args))


class WorldError(MdriveError):
    """The simulator failed, which makes the episode worthless; the episode becomes void."""

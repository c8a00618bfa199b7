"""The exceptions that a user of the library may catch. `loop.agent_driver.AgentFailure` completes the hierarchy."""


class MdriveError(Exception):
    """Base class of every error that mdrive-sumo raises on purpose."""


class InputError(MdriveError):
    """Unusable input. The text is one sentence for the user: what, where, expected, found. Exit code 2."""


class WorldError(MdriveError):
    """The simulator failed, which makes the episode worthless; the episode becomes void."""

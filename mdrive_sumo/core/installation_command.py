"""The command that installs an extra: one place that a release changes, and a test of the docs that follows it."""

SOURCE = "."
"""What pip is given. There is no release yet, so commands run in a clone of the repository; `mdrive-sumo` after one."""


def format_installation(*extras: str) -> str:
    """Return the shell command that installs mdrive-sumo with these extras."""
    return f"pip install '{SOURCE}[{','.join(extras)}]'"

"""The MDrive closed-loop cooperative-driving benchmark on Eclipse SUMO."""


def __getattr__(name: str) -> str:
    """`__version__`, read when it is asked for: where an agent runs there is the code, but no installed package."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    return version("mdrive-sumo")

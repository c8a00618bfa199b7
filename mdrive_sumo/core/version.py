"""The version of mdrive-sumo: the only line that a release changes, beside CITATION.cff. pyproject.toml reads it."""

__version__ = "0.2.0"

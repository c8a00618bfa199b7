"""The MDrive closed-loop cooperative-driving benchmark on Eclipse SUMO."""

from importlib.metadata import version

__version__ = version("mdrive-sumo")

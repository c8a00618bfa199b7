"""`mdrive-sumo serve` and `mdrive-sumo admin`."""

from server.cli.administration import admin
from server.cli.serving import application, serve

__all__ = ["admin", "application", "serve"]

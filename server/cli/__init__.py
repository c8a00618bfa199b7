"""`mdrive-sumo serve` and `mdrive-sumo admin`."""

from server.cli.admin_commands import admin
from server.cli.serve_command import make_app, serve

__all__ = ["admin", "make_app", "serve"]

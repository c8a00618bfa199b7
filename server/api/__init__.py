"""The HTTP API of the challenge, under /api/v1."""

from server.api.app import create_app

__all__ = ["create_app"]

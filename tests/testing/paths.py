"""Where the repository and its tests lie."""

from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
"""The folder from which worker processes import `testing`."""
ROOT = TESTS.parent

"""Clean a log: merge the views of all observers into one list of tracks, one per road user."""

from real2sim.clean.recording_cleaner import LEAST_FRAMES, Cleaned, clean

__all__ = ["LEAST_FRAMES", "Cleaned", "clean"]

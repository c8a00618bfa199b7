"""Clean a log: merge the views of all observers into one list of tracks, one per road user."""

from real2sim.clean.recording_cleaner import MIN_FRAMES, CleanedRecording, clean_recording

__all__ = ["MIN_FRAMES", "CleanedRecording", "clean_recording"]

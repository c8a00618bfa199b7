"""Recorded episodes in the formats of other tools: one file per format, listed in `export_formats`."""

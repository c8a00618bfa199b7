"""Studies: what cooperation is worth, and what the channel does to it. docs/studies.md says how to read the numbers."""

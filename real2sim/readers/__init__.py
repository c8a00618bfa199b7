"""Readers: one module per source format; each returns a Recording or a SourceScene."""

"""One file a source: each reads what others recorded and returns a Recording."""

"""Scenarios: the file format, and the suites that hold them."""

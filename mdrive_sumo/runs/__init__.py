"""Suites through worker processes into results: pool, journal, resume.

Nothing is imported here, so that a worker process starts with `suite.pool` alone.
"""

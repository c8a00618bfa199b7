"""Runs: a suite is driven in worker processes into results, with a journal to resume from.

Nothing is imported here, so that a worker process imports only what it needs.
"""

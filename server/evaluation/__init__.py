"""Drives submissions: jobs of the database through executors into results, each scored exactly once."""

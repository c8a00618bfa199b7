"""Writes packaged data from its recipes: the networks and the `interdrive` suite."""

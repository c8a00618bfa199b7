"""Worlds: the one factory of places, traffic and encounters that suites, seasons, the hard tier and training draw from.

Everything is drawn from a version and a seed: the same ones make the same bytes on every machine.
"""

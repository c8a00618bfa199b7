"""Streams of traffic that SUMO drives: along edges, along lanes of fast roads, and around the CAVs."""

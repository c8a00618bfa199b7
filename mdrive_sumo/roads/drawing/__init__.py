"""Geometry of networks for pictures and cameras: surfaces, markings, stop lines. No sensor of the 225 reads it."""

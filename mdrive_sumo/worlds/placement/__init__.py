"""Placement: poses on lanes and routes, bodies, free places, CAVs and the vehicles that SUMO drives."""

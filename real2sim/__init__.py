"""Recordings and foreign scenario files become scenarios of mdrive-sumo."""

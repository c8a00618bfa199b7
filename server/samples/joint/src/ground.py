"""Converts degrees to metres."""

import math

EARTH_RADIUS_M = 6_378_137.0


def metres(lat, lon, to_lat, to_lon):
    """Return the offset east and north to a point a few hundred metres away [m]."""
    east = EARTH_RADIUS_M * math.radians(to_lon - lon) * math.cos(math.radians(lat))
    return east, EARTH_RADIUS_M * math.radians(to_lat - lat)

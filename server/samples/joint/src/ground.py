"""From degrees to metres."""

import math

EARTH_RADIUS_M = 6_378_137.0


def metres(lat, lon, to_lat, to_lon):
    """East and north of a place a few hundred metres away."""
    east = EARTH_RADIUS_M * math.radians(to_lon - lon) * math.cos(math.radians(lat))
    return east, EARTH_RADIUS_M * math.radians(to_lat - lat)

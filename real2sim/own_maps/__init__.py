"""Own road networks: SUMO nets, OpenDRIVE maps and OpenStreetMap extracts become network folders."""

from real2sim.own_maps.convert_map import ConvertedMap, convert_map

__all__ = ["ConvertedMap", "convert_map"]

"""Classes of the pixels of a semantic camera."""

from enum import IntEnum


class SemanticClass(IntEnum):
    """What a pixel shows, by the numbers of CARLA 0.9.12, the paper's version, without classes that do not occur."""

    UNLABELLED = 0
    BUILDING = 1
    PEDESTRIAN = 4
    """Also the rider of a bicycle or motorcycle, as in CARLA."""
    POLE = 5
    ROAD_LINE = 6
    ROAD = 7
    SIDEWALK = 8
    VEHICLE = 10
    """Also bicycles and motorcycles without their riders, as in CARLA."""
    TRAFFIC_SIGN = 12
    SKY = 13
    TRAFFIC_LIGHT = 18
    STATIC = 19
    TERRAIN = 22

"""TEMPORARY stand-in."""
from mdrive_sumo.sensing.lidar import LidarSensor as GnssSensor, LidarSensor as ImuSensor, LidarSensor as SpeedometerSensor

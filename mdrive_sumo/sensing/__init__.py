"""What sensors see: line of sight, detections, LiDAR, bird's-eye rasters, instruments."""

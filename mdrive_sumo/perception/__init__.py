"""Perception of an agent: object lists fused from detections and messages, and tracks of static objects."""

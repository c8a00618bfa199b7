"""Cameras: images of the world rendered with OpenGL (extra `camera`)."""

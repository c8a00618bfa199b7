"""Learned agents: compact networks of our own, run by ONNX Runtime (docs/learning.md)."""

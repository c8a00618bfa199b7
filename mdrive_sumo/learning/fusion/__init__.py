"""Detectors that share features: frames of scans and truths, networks, training, evaluation."""

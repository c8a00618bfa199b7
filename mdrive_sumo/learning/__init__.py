"""Learning: training scenarios, training data, networks and their training (docs/learning.md)."""

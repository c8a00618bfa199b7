"""Learned systems: training data, networks, training, export. Running them is `agents.learned`."""

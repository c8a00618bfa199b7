"""The networks of the learned systems (PyTorch): shared parts and one short file for each system."""

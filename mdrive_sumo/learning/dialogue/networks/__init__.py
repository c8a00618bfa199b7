"""The network of the negotiator (PyTorch)."""

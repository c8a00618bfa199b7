"""Training of the negotiator (PyTorch)."""

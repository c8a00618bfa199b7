"""Training and export of the detectors in PyTorch."""

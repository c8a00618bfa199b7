"""Networks of the detectors in PyTorch."""

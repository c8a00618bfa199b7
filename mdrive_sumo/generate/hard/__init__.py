"""The hard tier: families of scenarios whose parameters an adversarial search varies."""

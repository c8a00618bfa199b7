"""The channels of `relay`."""

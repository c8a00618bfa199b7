"""Synthetic recordings in the V2XPnP format: dense traffic on our own maps, recorded, written and converted."""

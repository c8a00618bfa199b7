"""Synthetic recordings in the V2XPnP format: dense traffic on maps of our own, recorded, written, converted."""

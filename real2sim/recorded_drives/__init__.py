"""Synthetic recordings in the V2XPnP format: dense traffic at drawn places, recorded, written and converted."""

"""The Python front door. Import its names from `mdrive_sumo`, which loads them on first use."""

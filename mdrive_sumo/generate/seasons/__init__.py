"""Seasons: 225 fresh scenarios of the benchmark's composition, drawn from a number and, if wanted, a secret."""

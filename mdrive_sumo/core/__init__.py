"""Foundations without domain knowledge of scenarios or agents: geometry, state, clock, seeding, errors, statistics."""

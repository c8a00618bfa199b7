"""Builders of the data that the packages ship: networks, suites, synthetic recordings. Not part of the wheel."""

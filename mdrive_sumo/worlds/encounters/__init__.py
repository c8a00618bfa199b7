"""Encounters: the building blocks of a conflict: who, where, when, hidden by what, seen by whom."""

"""Encounters: building blocks of a conflict: which road users, where and when, what hides them and what sees them."""

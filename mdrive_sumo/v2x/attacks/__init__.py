"""Senders that lie: what leaves an attacker's station instead of what its agent sent. docs/attacks.md."""

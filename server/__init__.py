"""Room of the challenge server. It is empty until issue E; nothing imports it."""

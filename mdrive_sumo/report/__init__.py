"""Output for people: tables for the terminal, Markdown reports, plots and the replay page."""

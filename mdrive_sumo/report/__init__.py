"""What people read: tables for the terminal, Markdown, pictures and the replay page."""

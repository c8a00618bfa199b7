"""Vehicle-to-everything communication: what stations say (`messages`), and how it travels (`channel`)."""

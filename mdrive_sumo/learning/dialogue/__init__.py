"""A language model that negotiates: its dialogues, its network and its training."""

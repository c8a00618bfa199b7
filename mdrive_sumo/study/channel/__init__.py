"""What the channel of recorded runs did: reception, gaps, age of information, load, awareness."""

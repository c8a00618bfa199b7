"""The paper by one command: the counterparts of its tables and figures, measured with the agents that are installed."""

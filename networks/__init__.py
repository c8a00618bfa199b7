"""Road networks as data: one folder a network, with its recipe in plain XML, the compiled net and `network.json`."""

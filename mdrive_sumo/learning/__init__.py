"""Training of learned systems: scenarios, data, networks, export. `mdrive_sumo.agents.learned` drives the results."""

"""Traffic that SUMO drives around the CAVs."""

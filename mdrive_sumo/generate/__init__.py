"""Generation of scenarios from proposals, and validation of suites."""

"""Convert authored scenarios (routes and scripted road users) into suites."""

"""Sites of the hard tier's families on a road map, found by geometry and right of way."""

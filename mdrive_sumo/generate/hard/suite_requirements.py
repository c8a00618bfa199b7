"""What every season of the hard tier has (docs/hard.md): for the choice of its scenarios and for `validate`."""

LEAST_SCENARIOS = 150
LEAST_PLACES, MOST_OF_PLACE = 25, 8
"""Places of a suite, and scenarios of one of them: conclusions must not hang on one crossing."""
LEAST_CATEGORIES, OF_EACH_CATEGORY = 12, 2
"""Kinds of situations of a suite, each with so many scenarios."""
MOST_OF_CATEGORY = 0.2
"""Largest share of one category: the suite is about more than one situation."""
LEAST_PROVEN, PROVEN_PLACES = 40, 10
"""Scenarios whose certificate is of level `all`, and the places on which they are at least."""
CONTROLLED_SHARE = 1 / 3
"""Least share of the routes that meet a sign or lights."""
MOST_UNAIDED = 40.0
"""Mean of any agent without messages."""
GIVEN_RANGE = (40.0, 75.0)
"""Mean of the best rule that sees and talks."""
LEAST_REFERENCE = 97.0

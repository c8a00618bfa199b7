"""Motion planning of the built-in agents: paths, predictions, right of way, space-time search, detours."""

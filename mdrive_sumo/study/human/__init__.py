"""Studies with persons at the wheel: plan, order, progress, scripted drivers, results beside those of agents (RQ4)."""

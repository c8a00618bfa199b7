"""`uniad`: counterpart of UniAD."""

from mdrive_sumo.agents.learned.learned_agent import LearnedAgent


class UniadAgent(LearnedAgent):
    """Counterpart of UniAD, trained on mdrive-sumo data: six cameras, answers a plan."""

    system = "uniad"

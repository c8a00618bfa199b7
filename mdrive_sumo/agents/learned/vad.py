"""`vad`: counterpart of VAD."""

from mdrive_sumo.agents.learned.learned_agent import LearnedAgent


class VadAgent(LearnedAgent):
    """Counterpart of VAD, trained on mdrive-sumo data: six cameras and the lanes of its route, answers a plan."""

    system = "vad"

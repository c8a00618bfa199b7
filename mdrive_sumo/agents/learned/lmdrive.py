"""`lmdrive`: counterpart of LMDrive."""

from mdrive_sumo.agents.learned.learned_agent import LearnedAgent


class LmdriveAgent(LearnedAgent):
    """Counterpart of LMDrive, trained on mdrive-sumo data: cameras, LiDAR and instructions in English, answers a plan.

    Its navigator composes the instructions (`RouteInstructor`), as people do in the data of LMDrive.
    """

    system = "lmdrive"

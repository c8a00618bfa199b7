"""CollectionSettings: what a data set is made with, as a picklable value for worker processes."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import Agent
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.learning.learner_driver import find_driver_system
from mdrive_sumo.learning.recorded_rigs import find_recorded_rig
from mdrive_sumo.learning.sample_format import PLACES_FOLDER, SPLITS
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite

EXPERTS = ("omniscient", "sharing+negotiation", "single")
"""Built-in agents that answer with plans; the best first."""


@dataclass(frozen=True, slots=True)
class CollectionSettings:
    """What decides the samples of a data set; their number and the number of workers do not."""

    split: str
    seed: int
    expert: str
    rigs: tuple[str, ...] = ()
    """Names as `find_recorded_rig` returns them."""
    perturbation: float = 1.0
    driver: Path | None = None
    """Weights of the learner that drives; None: the expert drives."""
    mix: float = 0.0
    round: int = 0
    share: float = 1.0
    """Share of the decisions that are kept."""
    suite: str = ""
    """Suite that stands in for training scenarios, in tests."""
    places: Path = Path(PLACES_FOLDER)
    """Folder in which the places of training scenarios lie, or are drawn; what is in it decides nothing."""

    def __post_init__(self) -> None:
        """Raises InputError for unknown names."""
        for option, name, known in (("--split", self.split, SPLITS), ("--expert", self.expert, EXPERTS)):
            if name not in known:
                raise InputError(f"{option}: {describe_unknown(name, known)}")
        if self.driver is not None and not self.driver.is_file():
            raise InputError(f"--driver {self.driver}: expected a file with weights (ONNX), found none")
        if self.driver is not None and (rig := find_recorded_rig(find_driver_system(self.driver).rig)) not in self.rigs:
            raise InputError(f"--driver {self.driver}: expected the rig that it sees with, --rig {rig}, found none")

    @property
    def driver_checksum(self) -> str:
        """Checksum of the learner's weights; "" without one."""
        return "" if self.driver is None else compute_file_checksum(self.driver)

    @property
    def fingerprint(self) -> Fingerprint:
        """What makes two collections the same, as the journal keeps it: samples of two versions never mix."""
        from mdrive_sumo.learning.training_scenarios import VERSION  # here: it imports the generators

        learner = () if self.driver is None else (AgentSpec(find_driver_system(self.driver).name),)
        return {
            "collection": "mdrive-sumo/training-data/1",
            "split": self.split,
            "seed": self.seed,
            "expert": self.expert,
            "rigs": ",".join(self.rigs),
            "perturbation": str(self.perturbation),
            "driver": self.driver_checksum,
            "mix": str(self.mix),
            "round": self.round,
            "share": str(self.share),
            "suite": self.suite,
            "generator": VERSION,
            "code": compute_code_checksum(),
            **read_versions(learner),
        }

    def derive_episode_seed(self, index: int) -> int:
        """Return the seed of the episode of one scenario."""
        return derive_seed(self.seed, "learning", self.split, str(self.round), str(index))

    def format_episode(self, index: int) -> str:
        """Return the name of an episode in the keys of its samples: letters, digits and "-"."""
        return f"{self.split}-s{self.seed}-r{self.round}-{index:06d}"

    def build_expert(self) -> Agent:
        """Return a new expert for one CAV."""
        return AGENTS[self.expert]({})

    def load_scenario(self, index: int) -> tuple[Scenario, RoadMap] | None:
        """Return the scenario of an index, which is deterministic, and its network; None if there is none."""
        if self.suite:
            suite = load_suite(self.suite)
            scenario = suite.scenarios[index % len(suite)]
            folder = find_network_folder(scenario.network, suite.find_folder(scenario.id))
            return scenario, load_road_map(folder)
        from mdrive_sumo.learning.training_scenarios import build_training_scenario  # here: it imports the generators

        return build_training_scenario(self.split, self.seed, index, self.places)

    def draw_places(self, scenarios: int, workers: int, note: Callable[[str], None]) -> None:
        """Draw the places of the first scenarios that `places` lacks, in worker processes. Raises InputError."""
        if self.suite:
            return
        from mdrive_sumo.learning.training_places import draw_training_places  # here: it imports the generators

        draw_training_places(self.split, self.seed, scenarios, self.places, workers, note)

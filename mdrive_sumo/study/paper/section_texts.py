"""What each part of the study is the counterpart of, what the paper says there, and what can be compared with CARLA."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

NO_COUNTERPART: Mapping[str, str] = MappingProxyType(
    {
        "tab:benchmark_comparison": "compares benchmarks by their properties; nothing to measure",
        "fig:mdrive_hero, fig:mdrive_representative_scenarios, fig:mdrive_toolbox": (
            "illustrations; mdrive-sumo show and view draw scenarios and drives"
        ),
        "fig:codriving_failure": "one failure as an example; mdrive-sumo view RUN shows those of the runs in runs/",
        "fig:mdrive_human_experiments, part (b)": "drives as examples; mdrive-sumo view DIR shows those of a study",
        "fig:various_weather_conditions, fig:real2sim_demo": "renderings of CARLA; nothing to measure",
        "tab:sensors, tab:controllers": (
            "descriptions; the cameras are presets of the sensor camera, the controllers follow plans here too"
        ),
    }
)
"""Tables and figures of the paper without a counterpart in the study, and why."""


@dataclass(frozen=True, slots=True)
class SectionText:
    """The words of a section; labels are those of the paper's source, mdrive.tex."""

    title: str
    counterpart: str
    claim: str
    """What the paper says there; "" where it claims nothing."""
    comparable: str
    not_comparable: str

    def list_points(self) -> dict[str, str]:
        """Return the words by what they say, without empty ones."""
        points = {
            "Counterpart of": self.counterpart,
            "The paper": self.claim,
            "Comparable to CARLA": self.comparable,
            "Not comparable": self.not_comparable,
        }
        return {name: words for name, words in points.items() if words}


SCENARIOS = SectionText(
    "Scenarios",
    "tab:scenario_distribution and tab:llm_category_breakdown",
    "",
    "Numbers of scenarios, CAVs and actors, route lengths and heading changes are made to be those of the paper, by"
    " the same definitions.",
    "The scenarios themselves: they are synthetic, on other maps, and the V2XPnP bucket holds no real log.",
)
MAIN = SectionText(
    "Main table (RQ1)",
    "tab:mdrive_results",
    "Multi-agent models generally have a higher DS and SR than single-agent ones; CoDriving, which shares perception,"
    " leads on average, CoLMDriver on InterDrive.",
    "The protocol: the same scores, penalties, time limits and bucket means, on scenarios with the same statistics.",
    "The rows: the paper drives networks that were trained on camera images and point clouds, in CARLA's physics;"
    " here, planners with a model of a detector drive in SUMO's traffic, and so do compact networks that see simple"
    " renderings (tcp, vad, uniad, lmdrive: counterparts of TCP, VAD, UniAD and LMDrive, trained on mdrive-sumo data)"
    " or a LiDAR (codriving, and perception-swap:*, which the paper has in RQ3 only). codriving:* are variants of our"
    " own."
    " Only differences between rows of one simulator say anything, and no row is the reimplementation of a method of"
    " the paper.",
)
CATEGORY_FIGURE = SectionText(
    "Category figure (RQ1)",
    "fig:mdrive_highlevel_subscore, and the gaps in the text of subsec:rq1",
    "The gap between multi-agent and single-agent systems in H is 3.54 in static avoidance, 35.12 in dynamic avoidance"
    " and 24.58 in dynamic coordination.",
    "H, the levels and the way in which the gap is taken. Where codriving and codriving:alone are in the study, the gap"
    " of learned systems is split: alone has the planner and cap of the other, its weights unless options differ,"
    " and no messages, so their difference is what messages gain, and what is left comes from sensors, planner and"
    " training. The paper cannot separate them.",
    "The size of the gap: it depends on which agents are in each group. The paper's two groups differ in perception,"
    " planner and training besides cooperation. perception-swap:* are in no group, as in the paper.",
)
GAINS = SectionText(
    "What sharing and negotiation gain (RQ1, RQ2)",
    "the text of subsec:rq1 and subsec:rq2, which has no table",
    "Perception sharing prevents failures from lack of observability but does not guarantee better planning;"
    " negotiation benefits coordination among CAVs, and less where there is rich background traffic.",
    "The question. Here the agents of a pair have one planner and differ in what they exchange, so the difference is"
    " the gain of that; the paper cannot separate it from the planner. So it is for learned perception: codriving"
    " beside its twin without messages, detectors that share beside perception-swap:none.",
    "The language model: sharing+negotiation and colmdriver-rule negotiate by rule and hallucinate nothing. A detector"
    " that fuses and perception-swap:none were trained apart, so their difference has chance of training in it.",
)
CATEGORIES = SectionText(
    "Every category (RQ2)",
    "the 11 interaction categories of tab:llm_category_breakdown; the paper prints no scores for them",
    "",
    "The categories and their numbers of scenarios.",
    "Ten scenarios a category separate little: read rows, not single cells.",
)
OPEN_CLOSED = SectionText(
    "Open loop against closed loop (RQ3)",
    "fig:mdrive_olcl_correlation",
    "Better perception or prediction in open loop does not account for better driving in closed loop.",
    "The question, the metrics AP50, ADE and CR with their horizon of 3 s, and the scores DS and SR; detectors of one"
    " planner (perception-swap:*), whose order by precision stands beside their order by DS.",
    "The recorded drives are those of omniscient instead of logs of human drivers, so an agent that plans as"
    " omniscient drives has an advantage; agents other than codriving and perception-swap:* reply modelled detections,"
    " not those of networks; perception-swap:*:profile are surrogates, in which no detector runs; and the paper prints"
    " no number to compare a correlation with.",
)
HUMANS = SectionText(
    "Human drivers (RQ4)",
    "fig:mdrive_human_experiments",
    "CoLMDriver succeeds less often than human experts, and is slower when it negotiates.",
    "The question and the scores, of persons in a study by `study human` (--human-study DIR).",
    "Who drives: the paper has three students with a wheel in CARLA; each study has its own people, scenarios and"
    " conditions. Scripted drivers are programs and say nothing about people. The time ratio of the main table compares"
    " the time that agents need with that of omniscient, not with a person's.",
)
LATENCY = SectionText(
    "Latency (RQ5)",
    "tab:latency_results",
    "All three models lose under 6 ticks of latency, not uniformly: DS falls by 8.26, 0.67 and 5.96.",
    "6 ticks (300 ms) of delay on every received message, and differences paired by scenario.",
    "The paper adds the real computing time of its networks; here thinking takes no time, because a measured one would"
    " tie the table to a machine (study comm --agent-clock measured adds it). The paper does not name its 21"
    " scenarios.",
)
POSE_ERROR = SectionText(
    "Pose error (RQ5)",
    "tab:pose_error_results",
    "CoDriving hardly changes (DS -0.30); the negotiating models lose 3.73 and 8.16.",
    "Gaussian errors of 0.6 m and 0.6 degrees in the pose of every message, drawn for every message and receiver.",
    "Own localisation has errors besides (sensing profile realistic): with them the sum is 0.63 m. The paper does not"
    " name its 21 scenarios.",
)

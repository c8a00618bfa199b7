"""The published format of a recording is the format of a recorded file."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Message, Note, Observation, Plan, Reply
from mdrive_sumo.core.clock import Clock
from mdrive_sumo.episode import ThinkTimeEntry, load_episode, save_episode
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.episode.episode_schema import ARRAYS, DIMENSIONS, EpisodeHeader, build_episode_schema
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.v2x.comm_settings import PRESETS


def follow_plan(seen: Observation) -> Reply:
    """Drive by a plan, send a message and leave a note."""
    ahead = seen.own.x + np.arange(1, 6)
    plan = Plan(np.column_stack((ahead, np.zeros(5))), 0.2)
    return Reply(plan=plan, messages=(Message("note", b"hello"),), notes=(Note("test", "planned"),))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded run with contacts, plans, messages, notes, think times and two kinds of endings."""
    egos = (straight_ego("0", x=40, length=60), straight_ego("1", x=10, length=80), straight_ego("2", x=200, length=20))
    config = EpisodeConfig(
        straight_scenario(*egos),
        straight_road(),
        seed=0,
        about={"agent": "test"},
        options=EpisodeOptions(PRESETS["its-g5"], Clock("measured")),  # only recordings of a radio have all arrays
        think_times=(ThinkTimeEntry("2", 2, 3),),
    )
    agents = {
        "0": Says(lambda seen: pedals(brake=1.0)),
        "1": Says(lambda seen: pedals(throttle=1.0)),
        "2": Says(follow_plan),
    }
    record = run_episode(config, EmptyWorld(), {ego: LocalDriver(agent) for ego, agent in agents.items()})
    path = tmp_path_factory.mktemp("recording") / "episode.npz"
    save_episode(record, path)
    return path


@pytest.mark.slow
def test_a_recorded_file_has_the_published_arrays(recording: Path) -> None:
    sizes: dict[str, int] = {}
    with np.load(recording, allow_pickle=False) as data:
        assert set(data.files) == set(ARRAYS)
        for name, array in ARRAYS.items():
            found = data[name]
            assert found.dtype.name in array.dtype, name
            assert found.ndim == len(array.shape), name
            for expected, size in zip(array.shape, found.shape, strict=True):
                if isinstance(expected, int):
                    assert size == expected, name
                else:
                    assert sizes.setdefault(expected, size) == size, name
    record = load_episode(recording)
    assert set(sizes) == set(DIMENSIONS)
    assert (sizes["T"], sizes["N"], sizes["E"]) == (record.ticks, len(record.ids), 3)
    assert sizes["T8"] == -(-record.ticks // 8)
    assert sizes["P"] == sum(len(plan.points) for plan in record.plans) > 0
    assert sizes["B"] == sum(len(sent.message.payload) for sent in record.messages) > 0


def test_a_recorded_header_satisfies_the_published_types(recording: Path) -> None:
    with np.load(recording, allow_pickle=False) as data:
        header = json.loads(bytes(data["header"]))
    model = EpisodeHeader.model_validate_json(json.dumps(header), strict=True)
    assert model.contacts
    assert model.thinking == [("2", 2, 3)]
    assert all(header[name] for name in header if name not in ("signals",))
    with pytest.raises(ValidationError):
        EpisodeHeader.model_validate(header | {"contacts": [[1, "0", "1"]]})
    with pytest.raises(ValidationError):
        EpisodeHeader.model_validate(header | {"unknown": 1})


def test_the_schema_lists_every_array_and_every_header_field() -> None:
    schema = build_episode_schema()
    assert set(schema["arrays"]) == set(ARRAYS)
    assert set(schema["header"]["properties"]) == set(EpisodeHeader.model_fields)

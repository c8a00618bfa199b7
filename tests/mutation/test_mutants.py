"""Mutants of source text, the choice of a sample, and what fails `make mutants`."""

import ast
from collections.abc import Mapping
from pathlib import Path

import pytest
from testing.mutants import Mutant, list_mutants, mutate_source, sample_mutants
from testing.mutation_job import (
    LEAST_SHARE,
    ROOMS,
    ROOT,
    SEED,
    RoomVerdict,
    copy_tree,
    find_problems,
    find_sources,
    is_noticed,
    list_existing,
    measure_room,
    read_survivors,
)


def changes(source: str) -> list[str]:
    """What each mutant makes of the source."""
    return [mutant.apply(source.encode()).decode() for mutant in mutate_source(source.encode(), "m.py")]


CHANGED: Mapping[str, list[str]] = {
    "x = 3": ["x = 4"],
    "x = 2.0": ["x = 2.6"],
    "x = 0.0": ["x = 1.0"],
    "x = True": ["x = False"],
    "x = a <= b": ["x = a > b"],
    "x = a is  not None": ["x = a is None"],
    "x = a not in b": ["x = a in b"],
    "x = a < b < c": ["x = a >= b < c", "x = a < b >= c"],
    "x = a and b and c": ["x = a or b and c", "x = a and b or c"],
    "x = (a) + (b)": ["x = (a) - (b)"],
    "x = a // b": ["x = a * b"],
    "x -= a": ["x += a"],
    "x = not a": ["x = (a)"],
    "x = -a": ["x = (a)"],
    "x = min(a, b)": ["x = max(a, b)"],
    "if a:\n    pass": ["if (not (a)):\n    pass"],
    "if a == b:\n    pass": ["if a != b:\n    pass"],
    "x = a if b else c": ["x = a if (not (b)) else c"],
    "x = [a for a in b if a]": ["x = [a for a in b if (not (a))]"],
    "x = 'ü', 3": ["x = 'ü', 4"],
    "def f(a=1):\n    return a | b": ["def f(a=2):\n    return a | b", "def f(a=1):\n    return a & b"],
}
UNCHANGED = (
    '"""1 < 2"""',
    "X = int | None",
    "x: list[int] | None = None",
    "x = 1e-9",
    "if TYPE_CHECKING:\n    pass",
    "x = f'{a:.2f} {a + 1}'",
    "x = zip(a, b, strict=True)",
    "@dataclass(frozen=True)\nclass A(B[1]):\n    '''At least 1.'''",
    "def f(a: int | None) -> int | None: ...",
)


@pytest.mark.parametrize("source", CHANGED)
def test_every_operator_number_and_condition_is_changed_once(source: str) -> None:
    assert changes(source) == CHANGED[source]


@pytest.mark.parametrize("source", UNCHANGED)
def test_types_texts_and_checks_are_not_changed(source: str) -> None:
    assert changes(source) == []


@pytest.mark.slow
def test_mutants_of_the_rooms_are_modules_and_have_names_of_their_own() -> None:
    for room in ROOMS.values():
        mutants = list_mutants(ROOT, find_sources(room, ROOT))
        assert len(mutants) > 50
        assert len({mutant.name for mutant in mutants}) == len(mutants)
        for mutant in sample_mutants(mutants, 4, 0):
            assert ast.dump(ast.parse(mutant.apply((ROOT / mutant.path).read_bytes())))


def test_a_mutant_keeps_its_name_and_its_place_in_the_sample_when_other_lines_change() -> None:
    before = mutate_source(b"a = 1\nb = 2\nc = x + y\n", "m.py")
    after = mutate_source(b"import os\n\nz = 5\na = 1\nb = 2\nc = x + y\n", "m.py")
    names = [mutant.name for mutant in before]
    assert [mutant.name for mutant in after][1:] == names
    chosen = [mutant.name for mutant in sample_mutants(after, 4, 7) if mutant.name in names]
    assert chosen == [mutant.name for mutant in sample_mutants(before, 3, 7)]
    assert chosen != [mutant.name for mutant in sample_mutants(before, 3, 8)]


def mutant(name: str) -> Mutant:
    return Mutant("m.py", 0, "1", "2", 1, name)


def problems(sampled: int, survivors: list[Mutant], reasons: dict[str, str], existing: list[Mutant]) -> list[str]:
    others = [mutant(f"x = {i}") for i in range(sampled - len(survivors))]
    verdict = RoomVerdict([*survivors, *others], survivors)
    return list(find_problems({"room": verdict}, reasons, {one.name for one in existing}))


def test_a_survivor_needs_a_reason_and_a_reason_a_survivor() -> None:
    one, noticed = mutant("a = 1"), mutant("x = 0")
    assert problems(20, [], {}, []) == []
    assert problems(20, [one], {one.name: "equivalent"}, [one]) == []
    assert problems(20, [one], {}, [one]) == [f"survives, and is not in survivors.toml: {one.name}"]
    (said,) = problems(20, [], {noticed.name: "equivalent"}, [noticed])
    assert said == f"is in survivors.toml, but a test notices it: {noticed.name}"
    (said,) = problems(20, [], {"gone": "equivalent"}, [one])
    assert said == "is in survivors.toml, but the source has no such text: gone"


def test_a_room_whose_tests_notice_too_little_fails_whatever_the_reasons() -> None:
    few = [mutant(f"a = {i}") for i in range(3)]
    (said,) = problems(20, few, {one.name: "equivalent" for one in few}, few)
    assert said == f"room: 85% of the mutants are noticed, expected at least {LEAST_SHARE:.0%}"


@pytest.mark.slow
def test_every_listed_survivor_is_a_change_of_the_source() -> None:
    assert set(read_survivors()) <= list_existing()


@pytest.mark.full  # in `make test` the tests above; it copies the tree and starts a process per mutant, 30 s
def test_the_tests_of_the_channel_notice_a_sample_of_mutants(tmp_path: Path) -> None:
    room, tree = ROOMS["channel"], copy_tree(ROOT, tmp_path / "tree")
    tests, reasons = measure_room(room, tree), read_survivors()
    mutants = sample_mutants(list_mutants(ROOT, find_sources(room, ROOT)), 8, SEED)
    source = (tree.folder / mutants[0].path).read_bytes()
    noticed = [is_noticed(one, tests, tree) for one in mutants]
    survivors = [one.name for seen, one in zip(noticed, mutants, strict=True) if not seen]
    assert set(survivors) <= set(reasons)
    assert any(noticed)
    assert (tree.folder / mutants[0].path).read_bytes() == source

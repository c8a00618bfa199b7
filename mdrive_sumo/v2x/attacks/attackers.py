"""Which stations of a scenario attack."""

from collections.abc import Collection, Sequence

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.v2x.attacks.attack_settings import AttackSettings, StationGroup


def choose_attackers(
    attack: AttackSettings, cavs: Sequence[str], rsus: Sequence[str], scenario: str, seed: int
) -> frozenset[str]:
    """Return the ids of the attackers of a scenario; none if it has no station that may be one.

    They are drawn by seed, scenario and station: with the same seed a higher share keeps the attackers of a lower one,
    and all kinds of attack have the same attackers.
    """
    if attack.by:
        return frozenset(attack.by) & {*cavs, *rsus}
    stations = _list_candidates(attack.among, cavs, rsus)
    drawn = sorted(stations, key=lambda station: (derive_seed(seed, scenario, "attacker", station), station))
    if attack.share is None:
        return frozenset(drawn[:1])
    return frozenset(drawn[: max(1, (2 * len(drawn) * attack.share + 100) // 200)])


def _list_candidates(among: StationGroup, cavs: Sequence[str], rsus: Sequence[str]) -> list[str]:
    return [
        *(cavs if among is not StationGroup.RSUS else ()),
        *(rsus if among is not StationGroup.CAVS else ()),
    ]


def check_attackers(attack: AttackSettings, cavs: Collection[str], rsus: Collection[str]) -> None:
    """Raise InputError for attackers that do not exist. cavs, rsus: ids of all stations of a run's scenarios."""
    stations = {*cavs, *rsus}
    for station in attack.by:
        if station not in stations:
            raise InputError(
                f"--attack {attack.text}: expected attackers among {', '.join(sorted(stations))}, found {station!r}"
                f"{suggest_name(station, stations)}"
            )
    if not attack.by and attack.among is StationGroup.RSUS and not rsus:
        raise InputError(f"--attack {attack.text}: expected scenarios with a road-side unit, found none")

"""Trust in senders: it falls with every contradiction, and recovers with time."""

from dataclasses import dataclass

from mdrive_sumo.core.state import DT


@dataclass(frozen=True, slots=True)
class TrustParameters:
    """Parameters of `SenderTrust`. All values are chosen; docs/defence.md has what they were tried on."""

    least: float = 0.5
    """A sender is believed while trust in it, from 0 to 1, is at least this."""
    fall: float = 0.8
    """What a contradiction takes: after one, a sender is not believed."""
    recovery_s: float = 0.02
    """What a second without one gives back: 15 s after one contradiction, 25 s after two or more in a row."""


TRUST = TrustParameters()


class SenderTrust:
    """Trust in every sender. At first all are trusted."""

    def __init__(self, parameters: TrustParameters = TRUST) -> None:
        self._parameters = parameters
        self._fallen: dict[str, tuple[int, float]] = {}
        """Tick and trust after the last contradiction, by sender."""

    def get(self, sender: str, tick: int) -> float:
        """Return the trust in a sender, in [0, 1]."""
        if sender not in self._fallen:
            return 1.0
        since, trust = self._fallen[sender]
        return min(1.0, trust + self._parameters.recovery_s * DT * (tick - since))

    def is_believed(self, sender: str, tick: int) -> bool:
        """Return whether the messages of a sender count."""
        return self.get(sender, tick) >= self._parameters.least

    def record_contradiction(self, sender: str, tick: int) -> None:
        """Lower the trust in a sender."""
        self._fallen[sender] = tick, max(0.0, self.get(sender, tick) - self._parameters.fall)

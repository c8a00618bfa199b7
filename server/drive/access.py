"""Who may open what: tokens of links, the names under which the server may be addressed, logs without tokens."""

import ipaddress
import logging
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from hashlib import sha256
from urllib.parse import urlsplit

TOKEN_BYTES = 18
"""144 random bits, 24 characters: cannot be guessed, and fits a link that is read aloud if need be."""
LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


class SeatRole(StrEnum):
    """What a link lets its holder do."""

    DRIVER = "driver"
    SPECTATOR = "spectator"
    HOST = "host"
    """See all links: for the person who started the server."""


@dataclass(frozen=True, slots=True)
class Seat:
    """What a token is for."""

    session: str
    """Id of a drive session; "" for the host."""
    role: SeatRole
    cav: str = ""
    """CAV of a driver; "" for others."""


class TokenTable:
    """Tokens of one run of the server: they end with it. Only their hashes are kept."""

    def __init__(self) -> None:
        self._seat_by_hash: dict[bytes, Seat] = {}

    def issue(self, seat: Seat) -> str:
        """Return a new token for a seat."""
        token = secrets.token_urlsafe(TOKEN_BYTES)
        self._seat_by_hash[_hash(token)] = seat
        return token

    def find(self, token: str) -> Seat | None:
        """Return what a token is for; None if it is unknown. The time that it takes says nothing about tokens."""
        return self._seat_by_hash.get(_hash(token))

    def revoke(self, session: str) -> None:
        """Forget the tokens of a session."""
        self._seat_by_hash = {key: seat for key, seat in self._seat_by_hash.items() if seat.session != session}


def _hash(token: str) -> bytes:
    return sha256(token.encode("utf-8", "replace")).digest()


class HostCheck:
    """Which `Host` and `Origin` a request may have.

    DNS rebinding lets a page of another site reach a server of this machine under the other site's name; so names
    other than the server's own are refused. A numeric address cannot be rebound.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        """names: of hosts, besides `LOCAL_NAMES` and numeric addresses."""
        self._names = frozenset(name.casefold() for name in (*LOCAL_NAMES, *names))

    def is_host_allowed(self, host: str | None) -> bool:
        """Return whether a request with this `Host` header (name or address, with or without a port) is for us."""
        name = _find_name(host) if host else None
        return name is not None and (name in self._names or _is_address(name))

    def is_origin_allowed(self, origin: str | None, host: str | None) -> bool:
        """Return whether a WebSocket may be opened by a page of this origin.

        Browsers always name it; a client without one is no browser, so no other site's page stands behind it.
        """
        if origin is None:
            return True
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        is_same = parts.scheme in ("http", "https") and parts.netloc.casefold() == (host or "").casefold()
        return is_same and self.is_host_allowed(host)


_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([\w.-]+))(?::(\d{1,5}))?", re.ASCII | re.IGNORECASE)
"""`Host` as browsers write it (RFC 9110, section 7.2): no user before it, no path behind it."""


def _find_name(host: str) -> str | None:
    """Return the name or address in a `Host`; None if it is none."""
    found = _HOST.fullmatch(host)
    return (found[1] or found[2]).casefold() if found else None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


_TOKEN = re.compile(r"(token=)[\w%.~+-]+")


class TokenFilter(logging.Filter):
    """Hides the tokens of links in log records."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Replace tokens in the message; logging's callback."""
        message = record.getMessage()
        record.msg, record.args = _TOKEN.sub(r"\1...", message), ()
        return True

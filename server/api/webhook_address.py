"""Where webhooks may go. Teams choose the address, so it must lead to no machine that only this server can reach.

The rule, decision 043:

1. The scheme is https and the port 443 or 8443, without user, password and fragment.
2. The name is looked up for every attempt. All its addresses must be public, and the connection goes to one that was
   checked, not to the name: an answer of the name server that changes in between has no effect.
3. Redirects are not followed, and no proxy of the environment is used.
4. Hosts in the operator's `webhooks.allowed_hosts` are exempt from 1 and 2: http, any port, any address.
"""

import asyncio
import socket
from collections.abc import Awaitable, Callable, Collection, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address

import httpx

from mdrive_sumo.core.errors import InputError

PORTS = (443, 8443)
"""Ports of https that receivers use; others could lead to a service that is not one of the web."""
MAX_URL = 500
"""Length limit of an address [characters]."""
_IPV6_UNICAST = IPv6Network("2000::/3")
"""The only block from which public IPv6 addresses are allocated (IANA IPv6 address space)."""
_NOT_PUBLIC = tuple(
    map(
        IPv6Network,
        (
            "2001::/23",  # special purposes, among them Teredo, which contains an IPv4 address (RFC 2928, RFC 4380)
            "2001:db8::/32",  # documentation (RFC 3849)
            "2002::/16",  # 6to4, which contains an IPv4 address (RFC 3056)
            "3fff::/20",  # documentation (RFC 9637)
        ),
    )
)
_RELAYS = IPv4Network("192.88.99.0/24")
"""6to4 relays (RFC 7526)."""
Resolver = Callable[[str, int], Awaitable[Sequence[str]]]
"""Returns the addresses of a host for a port. Raises OSError."""


class AddressRefused(InputError):
    """The rule does not allow the address."""


def check_url(text: str, allowed_hosts: Collection[str]) -> httpx.URL:
    """Return the address of a webhook as far as the rule can be checked without looking up its name.

    Raises AddressRefused.
    """
    if not (len(text) <= MAX_URL and text.isascii() and text.isprintable()):
        raise AddressRefused(f"url: expected at most {MAX_URL} printable ASCII characters, found others or more")
    try:
        url = httpx.URL(text)
    except httpx.InvalidURL as error:
        raise AddressRefused(f"url: expected https://HOST/PATH, found {text!r:.80} ({error})") from None
    if not url.host or url.scheme not in ("http", "https") or url.userinfo or url.fragment:
        raise AddressRefused(f"url: expected https://HOST/PATH without user and fragment, found {text!r:.80}")
    if is_allowed(url, allowed_hosts):
        return url
    if url.scheme != "https" or find_port(url) not in PORTS:
        raise AddressRefused(f"url: expected https:// and the port 443 or 8443, found {text!r:.80}")
    if (address := _parse_address(find_host(url))) is not None and not is_public(str(address)):
        raise AddressRefused(f"url: expected a public address, found {find_host(url)}")
    return url


async def find_address(url: httpx.URL, allowed_hosts: Collection[str], attempt: int, resolve: Resolver) -> str:
    """Return the IP address to connect to, another one of the host's for each attempt.

    Raises AddressRefused unless all of them are public or the host is allowed, OSError if the name is unknown.
    """
    addresses = list(dict.fromkeys(await resolve(find_host(url), find_port(url))))
    if not addresses:
        raise OSError("the name has no address")
    if not is_allowed(url, allowed_hosts) and not all(map(is_public, addresses)):
        raise AddressRefused("the name leads to an address that is not public")
    return addresses[(attempt - 1) % len(addresses)]


async def resolve_host(host: str, port: int) -> Sequence[str]:
    """Return the addresses of a host in the system's order of preference. Raises OSError."""
    answers = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return [str(each[4][0]) for each in answers]


def is_allowed(url: httpx.URL, allowed_hosts: Collection[str]) -> bool:
    """Return whether the operator allows the host explicitly."""
    allowed = {host.lower() for host in allowed_hosts}
    host = find_host(url).lower()
    return bool(allowed & {host, f"{host}:{find_port(url)}"})


def find_host(url: httpx.URL) -> str:
    """Return the host as the name server and certificates spell it."""
    return url.raw_host.decode("ascii")


def find_port(url: httpx.URL) -> int:
    """Return the port, that of the scheme if none is given."""
    return url.port or {"http": 80, "https": 443}[url.scheme]


def is_public(address: str) -> bool:
    """Return whether an IP address belongs to the public Internet, and contains no other address that may not."""
    parsed = _parse_address(address)
    if parsed is None or parsed.is_multicast or not parsed.is_global:
        return False
    if isinstance(parsed, IPv4Address):
        return parsed not in _RELAYS
    return parsed in _IPV6_UNICAST and not any(parsed in network for network in _NOT_PUBLIC)


def _parse_address(text: str) -> IPv4Address | IPv6Address | None:
    try:
        return ip_address(text)
    except ValueError:
        return None

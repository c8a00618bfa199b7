"""Where webhooks may go, as tables: addresses that a name can lead to, and what teams can enter."""

import asyncio
from collections.abc import Sequence

import httpx
import pytest

from server.api import webhook_address

PUBLIC = "93.184.215.14"


@pytest.mark.parametrize(
    "addresses",
    [
        ("127.0.0.1",), ("10.1.2.3",), ("169.254.169.254",), ("100.64.0.1",), ("0.0.0.0",), ("224.0.0.1",),
        ("192.168.0.1", PUBLIC), (PUBLIC, "172.16.0.1"), ("::1",), ("fe80::1",), ("fd00::1",), ("::ffff:10.0.0.1",),
        ("64:ff9b::a00:1",), ("2002:a00:1::1",), ("2001:0:4136:e378:8000:63bf:f5ff:fffe",), ("2001:db8::1",),
        ("198.51.100.7",), ("255.255.255.255",), ("not an address",),
    ],
)  # fmt: skip
def test_no_address_of_the_inside_is_found(addresses: Sequence[str]) -> None:
    """Whatever the name server answers, at any attempt."""
    for attempt in range(1, 4):
        with pytest.raises(webhook_address.AddressRefused, match="not public") as refused:
            found(addresses, attempt)
        assert all(address not in str(refused.value) for address in addresses), "teams learn nothing of the inside"
        assert found(addresses, 1, ["ci.example"]) == addresses[0]


def found(addresses: Sequence[str], attempt: int = 1, allowed: Sequence[str] = ()) -> str:
    async def resolve(host: str, port: int) -> Sequence[str]:
        assert (host, port) == ("ci.example", 443)
        return addresses

    url = httpx.URL("https://ci.example/hook")
    return asyncio.run(webhook_address.find_address(url, allowed, attempt, resolve))


@pytest.mark.parametrize(
    "url",
    [
        "http://ci.example/", "ftp://ci.example/", "https://ci.example:22/", "https://user:secret@ci.example/",
        "https://ci.example/#part", "https://", "/hook", "nonsense", "https://127.0.0.1/", "https://[::1]/",
        "https://10.0.0.1/", "https://[::ffff:127.0.0.1]/", "https://ci.example/" + "a" * 500, "https://ci.exämple/",
        "https://ci.example/\n", "https://ci.example:99999/", "file:///etc/passwd", "https://[::1",
    ],
)  # fmt: skip
def test_bad_addresses_are_refused_in_one_sentence(url: str) -> None:
    with pytest.raises(webhook_address.AddressRefused, match=r"^url: expected .*, found "):
        webhook_address.check_url(url, ())


def test_hosts_that_the_operator_names_are_exempt() -> None:
    for url, allowed, is_fine in (
        ("http://hooks.internal:8080/a", ["hooks.internal"], True),
        ("http://hooks.internal:8080/a", ["hooks.internal:8080"], True),
        ("http://hooks.internal:8081/a", ["hooks.internal:8080"], False),
        ("https://evil.hooks.internal:22/a", ["hooks.internal"], False),
        ("http://127.0.0.1:9/", ["127.0.0.1"], True),
    ):
        if is_fine:
            assert str(webhook_address.check_url(url, allowed)) == url
        else:
            with pytest.raises(webhook_address.AddressRefused):
                webhook_address.check_url(url, allowed)


@pytest.mark.parametrize("address", [PUBLIC, "8.8.8.8", "2606:4700::1111", "2a00:1450:4001::5"])
def test_public_addresses_are_public(address: str) -> None:
    assert webhook_address.is_public(address)


def test_an_international_name_is_looked_up_as_certificates_spell_it() -> None:
    url = webhook_address.check_url("https://xn--bcher-kva.example/", ())
    assert webhook_address.find_host(url) == "xn--bcher-kva.example"

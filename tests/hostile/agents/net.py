"""Reaches for anything outside by socket. `argv`: port of a TCP service and name of an abstract socket of the host."""

import socket
import sys
from functools import partial

from tell import opened, tell


def connects(family: int, kind: int, address: object) -> bool:
    with socket.socket(family, kind) as made:
        made.settimeout(1)
        made.connect(address)  # type: ignore[arg-type]
    return True


def makes(family: int, kind: int, protocol: int = 0) -> bool:
    with socket.socket(family, kind, protocol):
        return True


port, abstract = int(sys.argv[1]), sys.argv[2]
tell(
    open=opened(
        {
            "tcp to the host": partial(connects, socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", port)),
            "tcp 6": partial(connects, socket.AF_INET6, socket.SOCK_STREAM, ("::1", port)),
            "udp": partial(makes, socket.AF_INET, socket.SOCK_DGRAM),
            "netlink": partial(makes, socket.AF_NETLINK, socket.SOCK_RAW),
            "packet": partial(makes, socket.AF_PACKET, socket.SOCK_RAW),
            "vsock": partial(makes, socket.AF_VSOCK, socket.SOCK_STREAM),
            "kernel crypto": partial(makes, socket.AF_ALG, socket.SOCK_SEQPACKET),
            "pair of another family": partial(socket.socketpair, socket.AF_INET, socket.SOCK_STREAM),
            "names": partial(socket.getaddrinfo, "example.org", 80),
            "abstract socket of the host": partial(connects, socket.AF_UNIX, socket.SOCK_STREAM, f"\0{abstract}"),
        }
    )
)

"""Messages between the processes of a drive: whole ones, in order, with the descriptors that belong to them."""

import os
import pickle
import socket
import threading

import pytest

from server.drive.message_socket import MessageSocket


def make_pair() -> tuple[MessageSocket, MessageSocket]:
    first, second = socket.socketpair()
    return MessageSocket(first), MessageSocket(second)


def receive(connection: MessageSocket, count: int) -> list[object]:
    messages: list[object] = []
    while len(messages) < count:
        messages += [pickle.loads(data) for data in connection.receive()]
    return messages


def test_messages_of_any_size_arrive_whole_and_in_order() -> None:
    ours, theirs = make_pair()
    sent = [b"x" * 10, b"y" * 3_000_000, {"a": (1, 2)}, None]
    sending = threading.Thread(target=lambda: [ours.send(message) for message in sent])
    sending.start()
    assert receive(theirs, 4) == sent
    sending.join()
    ours.close()
    with pytest.raises(EOFError):
        theirs.receive()
    theirs.close()


def test_descriptors_come_in_the_order_of_their_messages() -> None:
    ours, theirs = make_pair()
    pipes = [os.pipe() for _ in range(3)]
    for number, (_, write) in enumerate(pipes):
        ours.send("plain")
        ours.send(number, (write,))
        os.close(write)
    assert receive(theirs, 6) == ["plain", 0, "plain", 1, "plain", 2]
    for number, (read, _) in enumerate(pipes):
        descriptor = theirs.take_descriptor()
        os.write(descriptor, b"%d" % number)
        os.close(descriptor)
        assert os.read(read, 9) == b"%d" % number
        os.close(read)
    ours.close()
    theirs.close()

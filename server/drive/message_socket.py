"""MessageSocket: pickled values over a Unix socket between the processes of one drive, with descriptors beside them.

A message is its length (4 bytes) and a pickle. Both ends are processes that this program started.
"""

import pickle
import socket
import struct
from contextlib import suppress

LENGTH = struct.Struct("<I")
MAX_MESSAGE_BYTES = 2**30
"""The largest message is a scene or a motion of some MB."""
_CHUNK_BYTES = 2**16
_MAX_DESCRIPTORS = 4


class MessageSocket:
    """One end of a connection. Sending blocks until the other end has room."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(True)
        self._socket = connection
        self._buffer = bytearray()
        self._descriptors: list[int] = []

    def fileno(self) -> int:
        """Return the descriptor, for `select`."""
        return self._socket.fileno()

    def send(self, message: object, descriptors: tuple[int, ...] = ()) -> None:
        """Send a message; the receiver gets copies of the descriptors. Raises OSError if the other end is gone."""
        self.send_bytes(pickle.dumps(message), descriptors)

    def send_bytes(self, data: bytes, descriptors: tuple[int, ...] = ()) -> None:
        """Send a message that is pickled already."""
        head = LENGTH.pack(len(data))
        if descriptors:
            socket.send_fds(self._socket, [head], list(descriptors))
            self._socket.sendall(data)
        else:
            self._socket.sendall(head + data)

    def receive(self) -> list[bytes]:
        """Return the pickles of all messages that are whole after one read, which waits. Raises EOFError, OSError."""
        data, descriptors, _, _ = socket.recv_fds(self._socket, _CHUNK_BYTES, _MAX_DESCRIPTORS)
        self._descriptors += descriptors
        if not data:
            raise EOFError
        self._buffer += data
        messages: list[bytes] = []
        begin = 0
        while len(self._buffer) >= begin + LENGTH.size:
            (length,) = LENGTH.unpack_from(self._buffer, begin)
            end = begin + LENGTH.size + length
            if len(self._buffer) < end:
                break
            messages.append(bytes(self._buffer[begin + LENGTH.size : end]))
            begin = end
        del self._buffer[:begin]
        return messages

    def take_descriptor(self) -> int:
        """Return the oldest descriptor that came with a message; the caller closes it."""
        return self._descriptors.pop(0)

    def end(self) -> None:
        """Send nothing more: the other end reads what was sent, and then the end. It can still send."""
        with suppress(OSError):  # it is gone already
            self._socket.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Close this end, and descriptors that were not taken."""
        for descriptor in self._descriptors:
            socket.socket(fileno=descriptor).close()
        self._descriptors = []
        self._socket.close()

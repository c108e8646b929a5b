"""Where the page is served, and whether a browser can be opened beside it."""

import errno
import os
import socket
import sys


def check_port(host: str, port: int) -> None:
    """ValueError when nothing can listen there."""
    if not 1 <= port <= 65_535:
        raise ValueError(f"port={port} is not within 1 to 65535; the default is 8765")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ValueError(f"port={port} of {host} is in use by another program; write port={port + 1}") from None
        raise ValueError(
            f"nothing can listen on host={host} port={port} ({error.strerror}); write host=127.0.0.1"
        ) from None


def has_screen() -> bool:
    """Whether a browser that was opened could be seen: not on a server that somebody has logged in to."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))

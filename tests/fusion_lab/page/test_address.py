"""A port that cannot be had is said to be, before anything is loaded."""

import socket

import pytest

from fusion_lab.page.address import check_port, has_screen


def test_a_port_in_use_is_named_with_the_next_one():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(
            ValueError, match=f"port={port} of 127.0.0.1 is in use by another program; write port={port + 1}"
        ):
            check_port("127.0.0.1", port)
    check_port("127.0.0.1", port)


@pytest.mark.parametrize("host", ["no.such.host.invalid", "203.0.113.1"])
def test_a_host_that_is_not_this_machine_is_refused(host):
    with pytest.raises(ValueError, match=f"host={host} port=8765"):
        check_port(host, 8765)


@pytest.mark.parametrize("port", [0, -1, 65_536])
def test_a_port_that_there_is_not_is_refused(port):
    with pytest.raises(ValueError, match=f"port={port} is not within 1 to 65535"):
        check_port("127.0.0.1", port)


def test_a_server_has_no_screen(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not has_screen()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_screen()

"""Workers of a batch on this machine take orders from the batch alone."""

import os
import socket
import ssl

import psutil
import pytest
from distributed import Client

from accpinn.cli import main
from accpinn.study.cluster import connected, plain_scheduler


def listening() -> list[int]:
    """Ports of the processes below this one."""
    below = psutil.Process().children(recursive=True)
    return [c.laddr.port for p in below for c in p.net_connections() if c.status == "LISTEN"]


def answer(port: int, request: bytes, context: ssl.SSLContext | None = None) -> bytes:
    """The reply of a port to a stranger; empty where it ends the connection."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=0.5) as plain:
            with context.wrap_socket(plain) if context else plain as channel:
                channel.sendall(request)
                return channel.recv(1000)
    except OSError:  # an SSLError is one, too
        return b""


def test_no_port_of_a_batch_does_anything_for_who_has_not_its_certificate() -> None:
    anyone = ssl.create_default_context()
    anyone.check_hostname, anyone.verify_mode = False, ssl.CERT_NONE
    before = set(listening())  # as of an app that another test has started
    with connected(1, None) as client:
        assert client.submit(os.getpid, pure=False).result() != os.getpid()
        ports = [port for port in listening() if port not in before]
        addresses = [client.scheduler.address, *client.scheduler_info()["workers"]]
        assert len(addresses) == 2
        assert all(address.startswith("tls://127.0.0.1:") for address in addresses)
        assert {int(address.rpartition(":")[2]) for address in addresses} <= set(ports)
        for port in ports:
            for request in (b"GET /info/main/workers.html HTTP/1.0\r\n\r\n",
                          b"GET /metrics HTTP/1.0\r\n\r\n"):  # fmt: skip
                reply = answer(port, request)
                assert not reply or b" 404 " in reply, (port, reply)
            assert answer(port, b"GET / HTTP/1.0\r\n\r\n", anyone) == b""
        host = addresses[0].removeprefix("tls://")
        with pytest.raises((OSError, TypeError)):
            Client(f"tcp://{host}", timeout=1, set_as_default=False)


@pytest.mark.parametrize(
    ("address", "is_warned"), [("tcp://10.0.0.1:1", True), ("tls://10.0.0.1:1", False)]
)
def test_a_scheduler_without_tls_is_warned_of(
    address: str, is_warned: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bool(plain_scheduler(address)) is is_warned
    assert len(plain_scheduler(address)) < 300
    main(["batch", "no such folder", "--out", "x", "--scheduler", address])
    assert ("Warning" in capsys.readouterr().err) is is_warned

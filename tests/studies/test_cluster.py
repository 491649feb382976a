"""A peer that is no Dask scheduler is named as such, soon, whatever it says."""

import socket
import threading
import time

import pytest

from identify.studies import cluster
from identify.studies.job import BatchError

pytest.importorskip("distributed")
GREETINGS = {
    "a shell": b"SSH-2.0-OpenSSH_9.2p1\r\n",
    "zeros": b"\0" * 64,
    "a length without end": b"\xff" * 64,
    "a length, and less": (1000).to_bytes(8, "little") + b"x",
    "nothing": b"",
}


@pytest.fixture
def peer():
    """Starts a server that says something to whoever calls, and returns its address."""
    servers = []

    def start(greeting):
        server = socket.create_server(("127.0.0.1", 0))
        servers.append(server)

        def answer():
            held = []
            while True:
                try:
                    held.append(server.accept()[0])
                except OSError:
                    return
                held[-1].sendall(greeting)

        threading.Thread(target=answer, daemon=True).start()
        return f"tcp://127.0.0.1:{server.getsockname()[1]}"

    yield start
    for server in servers:
        server.close()


@pytest.mark.parametrize("greeting", GREETINGS.values(), ids=GREETINGS)
def test_peer_that_speaks_no_dask_is_refused_in_a_sentence(peer, greeting, monkeypatch):
    monkeypatch.setattr(cluster, "GREETING", 0.5)
    address, begun = peer(greeting), time.monotonic()
    with pytest.raises(BatchError, match=f"{address}: no Dask scheduler answers there"):
        cluster.ClusterWorkers(address)
    assert time.monotonic() - begun < 10


def test_nobody_at_the_address_is_refused_in_a_sentence():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(BatchError, match="no Dask scheduler answers there"):
        cluster.ClusterWorkers(f"tcp://127.0.0.1:{port}")

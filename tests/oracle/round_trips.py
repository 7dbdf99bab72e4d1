"""Round trips of eight bytes over TCP, which show the latency of a cable.

    python round_trips.py serve            answers the first who asks, until they end
    python round_trips.py ask HOST NUMBER  prints the times of NUMBER round trips [s], the shortest first

Both wait as ranks do: they ask again and again whether something has come, and let others have the processor in between.
"""

import os
import socket
import sys
import time

PORT, LENGTH = 5000, 8


def receive(peer):
    while True:
        try:
            return peer.recv(LENGTH)
        except BlockingIOError:
            os.sched_yield()


def prepare(peer):
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    peer.setblocking(False)
    return peer


def serve():
    with socket.create_server(("", PORT)) as server:
        print("ready", flush=True)
        peer = prepare(server.accept()[0])
        while said := receive(peer):
            peer.send(said)


def ask(host, number):
    with prepare(socket.create_connection((host, PORT))) as peer:
        times = []
        for _ in range(int(number)):
            began = time.perf_counter()
            peer.send(b"." * LENGTH)
            receive(peer)
            times.append(time.perf_counter() - began)
    print(*sorted(times))


if __name__ == "__main__":
    {"serve": serve, "ask": ask}[sys.argv[1]](*sys.argv[2:])

"""Round trips of eight bytes over TCP, which show the latency of a cable.

    python round_trips.py serve            answers the first who asks, until they end
    python round_trips.py ask HOST NUMBER  prints the times of so many round trips [s], the shortest first
"""

import socket
import sys
import time

PORT, LENGTH = 5000, 8


def serve():
    with socket.create_server(("", PORT)) as server:
        print("ready", flush=True)
        peer, _ = server.accept()
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while said := peer.recv(LENGTH):
            peer.sendall(said)


def ask(host, number):
    with socket.create_connection((host, PORT)) as peer:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        times = []
        for _ in range(int(number)):
            began = time.perf_counter()
            peer.sendall(b"." * LENGTH)
            peer.recv(LENGTH)
            times.append(time.perf_counter() - began)
    print(*sorted(times))


if __name__ == "__main__":
    {"serve": serve, "ask": ask}[sys.argv[1]](*sys.argv[2:])

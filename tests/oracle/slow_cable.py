"""A cable between two network namespaces that delays what goes through it, and limits its bytes a second.

    python slow_cable.py DELAY RATE

makes the two ends, the network devices `to_far` and `to_near`, and says `ready`; the caller moves them to their namespaces.
DELAY is that of one way, in seconds; RATE is in bits a second, each way. Many kernels are built without netem; TUN devices, of which
a process holds the other side, are nearly everywhere.
"""

import collections
import ctypes
import fcntl
import gc
import os
import platform
import select
import struct
import sys
import time

ENDS = "to_far", "to_near"

# Long packets, as network cards hand them over that cut and join them by themselves; shorter ones would only keep Python busy.
LONGEST = 65000

# Of linux/if_tun.h and sys/prctl.h.
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
PR_SET_TIMERSLACK = 29

# A short turn on the processor [ns]: the kernel lets it come before longer ones.
SLICE = 100_000


def end(name):
    """The process's side of a new network device, from which whole IP packets are read."""
    file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
    return file


class Way:
    """One direction of the cable: packets on their way, each with the time at which it arrives."""

    def __init__(self, source, target, delay, rate):
        self.source, self.target, self.delay, self.seconds_a_byte = source, target, delay, 8.0 / rate
        self.free, self.underway = 0.0, collections.deque()

    def take(self, now):
        """Takes all packets that wait at the beginning."""
        while True:
            try:
                packet = os.read(self.source, LONGEST + 1)
            except BlockingIOError:
                return
            except OSError:  # the end is not up, or is no more
                return
            self.free = max(self.free, now) + len(packet) * self.seconds_a_byte
            self.underway.append((self.free + self.delay, packet))

    def give(self, now):
        """Gives away the packets that have arrived."""
        while self.underway and self.underway[0][0] <= now:
            try:
                os.write(self.target, self.underway.popleft()[1])
            except OSError:  # likewise: lost, as in a cable that is cut
                continue


def be_prompt():
    """Sleeps as long as it means to, without the usual 50 µs more, and comes before those who compute for longer when it wakes up."""
    libc = ctypes.CDLL(None)
    libc.prctl(PR_SET_TIMERSLACK, 1)
    # Size, policy, flags, nice, priority, slice [ns], deadline, period. Kernels before 6.12 know no slices, and refuse.
    attributes = struct.pack("IIQiIQQQ", 48, 0, 0, 0, 0, SLICE, 0, 0)
    libc.syscall(314 if platform.machine() == "x86_64" else 274, 0, attributes, 0)  # sched_setattr
    gc.disable()


def relay(delay, rate):
    far, near = map(end, ENDS)
    ways = {far: Way(far, near, delay, rate), near: Way(near, far, delay, rate)}
    be_prompt()
    print("ready", flush=True)
    clock = time.perf_counter
    while True:
        next_one = min((way.underway[0][0] for way in ways.values() if way.underway), default=None)
        readable, _, _ = select.select(list(ways), [], [], None if next_one is None else max(0.0, next_one - clock()))
        for source in readable:
            ways[source].take(clock())
        for way in ways.values():
            way.give(clock())


if __name__ == "__main__":
    relay(*map(float, sys.argv[1:]))

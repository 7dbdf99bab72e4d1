"""Two machines in one: network namespaces that share a disk and are connected by a cable, and `mpirun` over both.

The cable is one of the kernel's (veth), or a slow one (`slow_cable.py`) with a delay and a limited rate. All is made in a user
namespace where the caller is not root; what is started inside ends with it.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from farm import PATIENCE

HERE = Path(__file__).resolve().parent

NAMES = "near", "far"
NETWORK = "10.9.0.0/24"

# Arguments: the folder of the machines; then, for a slow cable, the command that makes its ends.
SCRIPT = r"""
set -e
folder=$1; shift
mount -t tmpfs none /run
mkdir /run/netns
ip netns add near
ip netns add far
if [ $# -gt 0 ]; then
    exec 3< <(exec "$@" 2>&1)
    read -r said <&3
    if [ "$said" != ready ]; then echo "$said" "$(tail -1 <&3)" >&2; exit 1; fi
    ip link set to_far mtu 65000
    ip link set to_near mtu 65000
else
    ip link add to_far type veth peer name to_near
fi
ip link set to_far netns near
ip link set to_near netns far
ip -n near address add 10.9.0.1/24 dev to_far
ip -n far address add 10.9.0.2/24 dev to_near
for machine in near far; do
    ip -n $machine link set lo up
    # Of the ways to share a network, the one that every kernel has and that holds no packet back by a clock.
    ip netns exec $machine sh -c 'echo reno > /proc/sys/net/ipv4/tcp_congestion_control'
done
ip -n near link set to_far up
ip -n far link set to_near up
printf '127.0.0.1 localhost\n10.9.0.1 near\n10.9.0.2 far\n' > "$folder/hosts"
mount --bind "$folder/hosts" /etc/hosts
ip netns exec far true
echo ready $$
exec cat
"""

# How mpirun starts its part on the other machine, and what starts each rank: both sides' words and exit codes are kept.
AGENT = '#!/bin/sh\nmachine=$1; shift\nexec ip netns exec "$machine" sh -c "$*"\n'
RANK = '#!/bin/sh\nfolder=$1; shift\n"$@" 2> "$folder/words.$OMPI_COMM_WORLD_RANK"\ncode=$?\n' \
       'echo $code > "$folder/code.$OMPI_COMM_WORLD_RANK"\nexit $code\n'


class NoMachines(Exception):
    """No network namespaces can be made here, or no slow cable between them."""


class Machines:
    """Two machines that share a disk and are connected by a cable: the kernel's, or one with a delay of one way [s] and a rate each way
    [bit/s]."""

    def __init__(self, folder, delay=None, rate=10e9):
        missing = [name for name in ("ip", "unshare", "nsenter") if not shutil.which(name)]
        if missing:
            raise NoMachines(f"no {' and no '.join(missing)}")
        self.folder = folder
        for name, text in (("agent", AGENT), ("rank", RANK)):
            (folder / name).write_text(text)
            (folder / name).chmod(0o755)
        cable = [] if delay is None else [sys.executable, str(HERE / "slow_cable.py"), str(delay), str(rate)]
        as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
        command = ["unshare", *as_root, "--mount", "--net", "--pid", "--fork", "--mount-proc", "--kill-child", "bash", "-c", SCRIPT,
                   "bash", str(folder), *cable]
        self.shell = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if not self.shell.stdout.readline().startswith("ready"):
            said = self.shell.communicate(timeout=PATIENCE)[1]
            raise NoMachines(f"no network namespaces with such a cable can be made here: {said.strip()[-300:]}")
        inside = Path(f"/proc/{self.shell.pid}/task/{self.shell.pid}/children").read_text().split()[0]
        self.enter = ["nsenter", *([] if not as_root else ["--user", "--preserve-credentials"]), "--mount", "--net", "--pid",
                      "--target", inside]

    def command(self, machine, *words):
        return [*self.enter, "ip", "netns", "exec", machine, *map(str, words)]

    def mpirun(self, ranks, *words):
        """The command that starts ranks, the first half of them near and the second far, all of whose messages go over TCP: between the
        machines through the cable."""
        near = (ranks + 1) // 2
        tcp = ["--mca", "pml", "ob1", "--mca", "btl", "tcp,self", "--mca", "btl_tcp_if_include", NETWORK]
        return self.command("near", "mpirun", "-n", ranks, "--host", f"near:{near},far:{max(ranks - near, 1)}", "--map-by", "slot", *tcp,
                            "--mca", "plm_rsh_agent", self.folder / "agent", *words)

    def ask(self, *words):
        return subprocess.run([*self.enter, *words], capture_output=True, text=True, check=True, timeout=PATIENCE).stdout

    def round_trips(self, number):
        """Times of round trips of a small message over TCP [s], the shortest first."""
        script = [sys.executable, HERE / "round_trips.py"]
        with subprocess.Popen(self.command("far", *script, "serve"), stdout=subprocess.PIPE, text=True) as server:
            server.stdout.readline()
            asked = subprocess.run(self.command("near", *script, "ask", "far", number), capture_output=True, text=True, check=True)
        return [float(word) for word in asked.stdout.split()]

    def passed(self):
        """Bytes that have gone through the cable so far, both ways."""
        counted = [self.ask("ip", "netns", "exec", "near", "cat", f"/sys/class/net/to_far/statistics/{way}_bytes") for way in ("rx", "tx")]
        return sum(map(int, counted))

    def cut(self):
        self.ask("ip", "-n", "near", "link", "set", "to_far", "down")

    def left(self):
        """Processes on both machines."""
        return [(machine, int(pid)) for machine in NAMES for pid in self.ask("ip", "netns", "pids", machine).split()]

    def close(self):
        self.shell.kill()
        self.shell.communicate(timeout=PATIENCE)

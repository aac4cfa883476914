"""Two hosts on this machine, as namespaces, joined by a cable that is as slow and as bad as one likes.

``python tests/hosts.py --delay 5 run/mpi -n 2 --host one,two python -m app.solve ...`` runs a command on the first.
Root and iproute2 are needed, and /dev/net/tun; not the kernel's netem.

Each host has a network, a name, mounts and process numbers of its own. As by ssh, what is started on it begins with a
small environment, in the home folder.
"""

import argparse
import fcntl
import os
import select
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path

NAMES = ("one", "two")
ADDRESSES = ("10.77.0.1", "10.77.0.2")
FILES = {"net": "net", "uts": "uts", "ipc": "ipc", "mount": "mnt", "pid": "pid"}  # of namespaces, in /proc
NAMESPACES = [f"--{name}" for name in FILES]
TUN, NO_HEADER, ATTACH = 0x0001, 0x1000, 0x400454CA  # IFF_TUN, IFF_NO_PI, TUNSETIFF
FIRST = "read number rest </proc/self/stat; echo $number; sleep infinity & wait"  # it buries orphans, too
FRAME = 65536  # bytes


def missing():
    """What keeps hosts from being made here; empty if nothing does."""
    if os.geteuid() != 0:
        return "not root"
    if not all(map(shutil.which, ("ip", "unshare", "nsenter"))):
        return "no iproute2 or util-linux"
    if not Path("/dev/net/tun").exists():
        return "no /dev/net/tun"
    made = subprocess.run(["unshare", *NAMESPACES, "--fork", "true"], stderr=subprocess.DEVNULL)
    return "" if made.returncode == 0 else "no right to make namespaces"


class Cable(threading.Thread):
    """Carries packets between two network devices.

    Attributes
    ----------
    delay : float
        Of a packet, one way [s].
    rate : float
        Of each way [byte/s].
    cut : set of int
        Hosts, 0 or 1, whose packets are lost.
    packets : list of int
        Carried so far, from each host.
    """

    def __init__(self, delay, rate):
        super().__init__(daemon=True)
        self.delay, self.rate, self.cut, self.packets = delay, rate, set(), [0, 0]
        self.devices = [f"cable{os.getpid()}{name[0]}" for name in NAMES]
        self._ends = [os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK) for _ in NAMES]
        for end, device in zip(self._ends, self.devices, strict=True):
            fcntl.ioctl(end, ATTACH, struct.pack("16sH22x", device.encode(), TUN | NO_HEADER))
        self._ended = False

    def run(self):
        """Carry."""
        waiting, free = (deque(), deque()), [0.0, 0.0]
        while not self._ended:
            due = min((queue[0][0] for queue in waiting if queue), default=float("inf"))
            readable, _, _ = select.select(self._ends, [], [], min(max(due - time.monotonic(), 0), 0.2))
            now = time.monotonic()
            for end in readable:
                side = self._ends.index(end)
                with suppress(OSError):
                    packet = os.read(end, FRAME)
                    free[side] = max(free[side], now) + len(packet) / self.rate
                    waiting[side].append((free[side] + self.delay, packet))
            for side, queue in enumerate(waiting):
                while queue and queue[0][0] <= time.monotonic():
                    _, packet = queue.popleft()
                    if side not in self.cut:
                        self.packets[side] += 1
                        with suppress(OSError):
                            os.write(self._ends[1 - side], packet)

    def end(self):
        """Carry no more."""
        self._ended = True
        self.join()
        for end in self._ends:
            os.close(end)


class Hosts:
    """Context of two hosts.

    Parameters
    ----------
    delay, rate : float
        Of the cable [s, byte/s].
    """

    def __init__(self, delay=0.0, rate=1.25e9):
        self.cable = Cable(delay, rate)
        self._holders, self._firsts = [], []
        self._folder = Path(tempfile.mkdtemp(prefix="hosts"))

    def __enter__(self):
        self.cable.start()
        try:
            self._make()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for first in self._firsts:
            with suppress(ProcessLookupError):
                os.kill(first, signal.SIGKILL)
        for holder in self._holders:
            holder.wait()
            holder.stdout.close()
        self.cable.end()
        shutil.rmtree(self._folder)

    def _make(self):
        known = "".join(f"{address} {name}\n" for address, name in zip(ADDRESSES, NAMES, strict=True))
        (self._folder / "proc").mkdir()
        (self._folder / "hosts").write_text(f"127.0.0.1 localhost\n{known}")
        for name, address, device in zip(NAMES, ADDRESSES, self.cable.devices, strict=True):
            # The first process there tells its number and holds the namespaces; with it ends the host. Only from the
            # numbers of processes on one can those on two be reached.
            inside = ["nsenter", "-t", str(self._firsts[0]), "-p"] if self._firsts else []
            holder = subprocess.Popen(
                [*inside, "unshare", *NAMESPACES, "--fork", "sh", "-c", FIRST],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            self._holders.append(holder)
            self._firsts.append(int(holder.stdout.readline()))
            subprocess.run(
                ["ip", "link", "set", device, "netns", str(self._firsts[-1]), "name", "eth0"], check=True
            )
            self.on(
                name,
                f"hostname {name}; ip link set lo up; ip addr add {address}/24 dev eth0; ip link set eth0 up;"
                f"mount -t tmpfs none /dev/shm; mount --bind {self._folder}/hosts /etc/hosts;"
                # The processes of all, for the agent; hwloc wants to see those of this host.
                f"mount --bind /proc {self._folder}/proc; mount -t proc proc /proc",
            )
        self.agent, spaces = self._folder / "agent", f"{self._folder}/proc/$pid/ns"
        where = " ".join(f"--{name}={spaces}/{file}" for name, file in FILES.items())
        cases = "".join(
            f"{name}|{address}) pid={pid} ;;\n"
            for name, address, pid in zip(NAMES, ADDRESSES, self._firsts, strict=True)
        )
        self.agent.write_text(
            f'#!/bin/sh\ncase $1 in\n{cases}*) echo "$1: no such host" >&2; exit 255 ;;\nesac\nshift\n'
            'exec env -i HOME="$HOME" USER="$USER" PATH=/usr/local/bin:/usr/bin:/bin '
            f'nsenter {where} sh -c "cd; $*"\n'
        )
        self.agent.chmod(0o755)

    def command(self, host, command):
        """A command line that runs another one on a host, in this folder and environment."""
        pid = self._firsts[NAMES.index(host)]
        return ["nsenter", "-t", str(pid), "-n", "-u", "-i", "-m", "-p", f"--wd={os.getcwd()}", *command]  # noqa: PTH109

    def on(self, host, line):
        """Run a line of shell on a host."""
        subprocess.run(self.command(host, ["sh", "-ec", line]), check=True)

    def start(self, command, **how):
        """Start a command on the first host, whose Open MPI reaches the second without ssh."""
        environment = {**os.environ, **how.pop("env", {}), "OMPI_MCA_plm_rsh_agent": str(self.agent)}
        return subprocess.Popen(self.command(NAMES[0], list(map(str, command))), env=environment, **how)

    def kill(self, host):
        """End all processes of a host at once."""
        os.kill(self._firsts[NAMES.index(host)], signal.SIGKILL)


def main(argv=None):
    """Run a command on the first of two hosts; return its status."""
    parser = argparse.ArgumentParser(description="Run a command on the first of two hosts, one and two.")
    parser.add_argument("--delay", type=float, default=0, help="of the cable, one way, in ms")
    parser.add_argument("--rate", type=float, default=10, help="of the cable, each way, in Gbit/s")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args(argv)
    if reason := missing():
        parser.error(f"no hosts can be made here: {reason}")
    with Hosts(arguments.delay / 1e3, arguments.rate * 1.25e8) as hosts:
        status = hosts.start(arguments.command).wait()
        print(f"[hosts] packets: {hosts.cable.packets}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())

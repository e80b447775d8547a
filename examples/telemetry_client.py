#!/usr/bin/env python3
"""Prints the telemetry of tumbled: pose and age, a line for every datagram. Layout: docs/telemetry.md.

Needs nothing but Python 3.8. Ends with 3 when the data are not live and --allow-nonlive is not given.
"""
import argparse
import socket
import struct
import sys
import time
import zlib

FORMAT = struct.Struct("<4sHHBBBBI16sqqQ3d4d3d3d3dd12dII")
VERSION = 1
ORIGINS = {1: "live", 2: "replay", 3: "simulated"}
MODES = {0: "no_target", 1: "acquiring", 2: "tracking", 3: "predicted", 4: "lost"}
VALIDITIES = {0: "invalid", 1: "degraded", 2: "ok"}


class Wrong(Exception):
    """A datagram that is not one."""


def read(datagram):
    """The fields of a datagram by name; raises Wrong."""
    if len(datagram) < 8 or datagram[:4] != b"TMBL":
        raise Wrong("not telemetry of tumbled")
    (version,) = struct.unpack_from("<H", datagram, 4)
    if version != VERSION:
        raise Wrong(f"layout {version}, and this reads {VERSION}: use the client that came with the daemon")
    if len(datagram) != FORMAT.size:
        raise Wrong(f"{len(datagram)} bytes instead of {FORMAT.size}")
    values = FORMAT.unpack(datagram)
    if values[2] != FORMAT.size:
        raise Wrong(f"it says {values[2]} bytes and has {FORMAT.size}")
    if values[-1] != zlib.crc32(datagram[:-4]):
        raise Wrong("damaged: the checksum does not fit")
    return {
        "origin": values[3],
        "mode": values[4],
        "validity": values[5],
        "kind": values[6],
        "sequence": values[7],
        "session": values[8],
        "t_ns": values[9],
        "unix_ns": values[10],
        "epoch": values[11],
        "position_m": values[12:15],
        "rotation_xyzw": values[15:19],
        "velocity_mps": values[19:22],
        "angular_velocity_rps": values[22:25],
        "spin_axis": values[25:28],
        "spin_rate_rps": values[28],
        "sigma": values[29:41],
        "reasons": values[41],
    }


class Sequence:
    """Follows the numbers of the datagrams."""

    def __init__(self):
        self.session = None
        self.next = 0

    def missing(self, state):
        """How many are missing before this one; None: it comes late or twice."""
        if state["session"] != self.session:
            self.session = state["session"]
            self.next = state["sequence"]
        # The number wraps: a step of more than half of all numbers is one back.
        step = (state["sequence"] - self.next) & 0xFFFFFFFF
        if step >= 0x80000000:
            return None
        self.next = (state["sequence"] + 1) & 0xFFFFFFFF
        return step


def line(state, now_ns):
    """What is printed."""
    numbers = lambda values, digits: " ".join(f"{value:+.{digits}f}" for value in values)
    return (
        f"{state['sequence']} {ORIGINS.get(state['origin'], '?')} {MODES.get(state['mode'], '?')} "
        f"{VALIDITIES.get(state['validity'], '?')} position {numbers(state['position_m'], 4)} "
        f"rotation {numbers(state['rotation_xyzw'], 5)} age {(now_ns - state['unix_ns']) / 1e6:.1f} ms"
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--bind", default="127.0.0.1", help="address to listen on")
    arguments.add_argument("--port", type=int, required=True, help="port to listen on; 0: any, said on stderr")
    arguments.add_argument("--count", type=int, default=0, help="stop after so many datagrams; 0: never")
    arguments.add_argument("--allow-nonlive", action="store_true", help="take replayed and simulated data too")
    asked = arguments.parse_args()

    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind((asked.bind, asked.port))
    print(f"listening on {asked.bind}:{receiver.getsockname()[1]}", file=sys.stderr, flush=True)
    sequence = Sequence()
    good = 0
    while asked.count == 0 or good < asked.count:
        datagram = receiver.recv(2048)
        try:
            state = read(datagram)
        except Wrong as wrong:
            print(f"dropped: {wrong}", file=sys.stderr, flush=True)
            continue
        if state["origin"] != 1 and not asked.allow_nonlive:
            name = ORIGINS.get(state["origin"], "of unknown origin")
            print(f"refused: the data are {name}, not live (--allow-nonlive takes them)", file=sys.stderr)
            return 3
        missing = sequence.missing(state)
        if missing is None:
            print(f"dropped: {state['sequence']} comes late", file=sys.stderr, flush=True)
            continue
        if missing:
            print(f"lost: {missing} before {state['sequence']}", file=sys.stderr, flush=True)
        good += 1
        print(line(state, time.time_ns()), flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        pass

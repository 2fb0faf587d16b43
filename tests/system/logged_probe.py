"""The simulated probe on a pty, which logs what it sent and when: the truth about a killed host.

    python tests/system/logged_probe.py LOG [--speed X] [--seed N]

The first line of standard output is the URL. Each line of LOG: monotonic time in s, bytes in hex.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from sim_device.build import build_device
from sim_device.serve import PtyHost, serve


class LoggedPty(PtyHost):
    def __init__(self, log: Path) -> None:
        super().__init__()
        self._log = log.open("w")

    def send(self, data: bytes) -> None:
        super().send(data)
        if data:
            self._log.write(f"{time.monotonic():.6f} {data.hex()}\n")
            self._log.flush()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    device = build_device(None, seed=arguments.seed, speed=arguments.speed, aperture_mm=6.0)
    host = LoggedPty(arguments.log)
    sys.stdout.write(f"{host.url}\n")
    sys.stdout.flush()
    serve(device, host, arguments.speed)

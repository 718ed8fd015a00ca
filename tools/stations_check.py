#!/usr/bin/env python3
"""The unmodified MAVProxy and MAVSDK against a vehicle: `tools/stations_check.py PORT [mavproxy|mavsdk ...]`.

PORT is what `tvc rig --pty` prints, or a board's port; the drone must be at rest, its polarity checked. Needs
`pip install MAVProxy 'mavsdk>=4'` (tried with 1.8.75 and 4.1.0); `tools/client_check.py` does the same with pymavlink.
Each connects, fetches every parameter, sets each to its own value and one to another, asks for angles, arms and disarms.
Ends with status 1 if anything is not as it should be.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

PATIENCE_S = 30


def check(holds, what):
    print(("ok      " if holds else "FAILED  ") + what, flush=True)
    if not holds:
        sys.exit(1)


class Console:
    """MAVProxy with its standard streams."""

    def __init__(self, port):
        self.folder = tempfile.TemporaryDirectory()
        program = shutil.which("mavproxy.py") or os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        self.process = subprocess.Popen(
            [sys.executable, program, f"--master={port}", "--baudrate=115200",
             f"--state-basedir={self.folder.name}", "--default-modules=param,arm,cmdlong"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=self.folder.name,
        )
        self.said = ""
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while block := os.read(self.process.stdout.fileno(), 4096):
            self.said += block.decode(errors="replace")

    def type(self, line):
        self.process.stdin.write((line + "\n").encode())
        self.process.stdin.flush()

    def ask(self, line, *parts):
        """Types a line, if any; whether all parts are said then in time."""
        if line is not None:
            self.said = ""
            self.type(line)
        if wait(lambda: all(part in self.said for part in parts)):
            return True
        print(self.said)
        return False

    def shown(self, line, pattern):
        """What the station shows when it is asked by a line; None while it shows nothing."""
        self.said = ""
        self.type(line)
        wait(lambda: re.search(pattern, self.said), 1)
        return re.search(pattern, self.said)

    def set(self, name, value):
        """Sets a parameter; whether the station shows the value in time."""
        self.type(f"param set {name} {value}")

        def is_shown():
            shown = self.shown(f"param show {name}", rf"\b{name}\s+(-?[0-9.]+)")
            return shown and abs(float(shown[1]) - value) < 1e-4

        return wait(is_shown)

    def file(self, name):
        with open(os.path.join(self.folder.name, name), encoding="utf-8") as file:
            return file.read()

    def end(self):
        self.process.kill()
        self.process.wait()


def mavproxy(port):
    console = Console(port)
    try:
        check(console.ask(None, "Saved", "parameters to"), "MAVProxy: heartbeat, every parameter fetched")
        check("timed out" not in console.said, "MAVProxy: no request without an answer")
        rows = [line.split() for line in console.file("mav.parm").splitlines()]
        kept = {name: float(value) for name, value in rows}
        for name, value in kept.items():
            check(console.set(name, value), f"MAVProxy: {name} set to {value:g}")
        other = 0.5 if kept["PID_KP"] != 0.5 else 0.6
        try:
            check(console.set("PID_KP", other), f"MAVProxy: PID_KP set to {other}")
        finally:
            back = console.set("PID_KP", kept["PID_KP"])
        check(back, "MAVProxy: PID_KP set back")
        check(console.ask("long SET_MESSAGE_INTERVAL 30 50000", "ACCEPTED"), "MAVProxy: ATTITUDE at 20 Hz")
        check(wait(lambda: console.shown("status ATTITUDE", "pitch :")), "MAVProxy: angles")
        armed = console.ask("arm throttle", "ARMED", "COMPONENT_ARM_DISARM: ACCEPTED")
        # Whatever has failed, the vehicle is not left armed.
        disarmed = console.ask("disarm", "DISARMED", "COMPONENT_ARM_DISARM: ACCEPTED")
        check(armed, "MAVProxy: armed")
        check(disarmed, "MAVProxy: disarmed")
    finally:
        console.end()


def mavsdk(port):
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.param import Param
    from mavsdk.plugins.telemetry import Telemetry

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"serial://{os.path.realpath(port)}:115200")
    system = sdk.first_autopilot(PATIENCE_S)
    check(system is not None, "MAVSDK: heartbeat")
    param = Param(system)
    rows = param.get_all_params().float_params
    check(len(rows) > 40, f"MAVSDK: {len(rows)} parameters fetched")
    kept = {row.name: row.value for row in rows}
    for name, value in kept.items():
        param.set_param_float(name, value)
        check(param.get_param_float(name) == value, f"MAVSDK: {name} set to {value:g}")
    other = 0.5 if kept["PID_KP"] != 0.5 else 0.625
    try:
        param.set_param_float("PID_KP", other)
        check(param.get_param_float("PID_KP") == other, f"MAVSDK: PID_KP set to {other}")
    finally:
        param.set_param_float("PID_KP", kept["PID_KP"])
    check(param.get_param_float("PID_KP") == kept["PID_KP"], "MAVSDK: PID_KP set back")
    telemetry = Telemetry(system)
    telemetry.set_rate_attitude_euler(20.0)
    time.sleep(1)
    angles, turned = telemetry.attitude_euler(), telemetry.attitude_quaternion()
    check(abs(angles.pitch_deg) < 90, f"MAVSDK: pitch {angles.pitch_deg:.1f} deg")
    check(abs(turned.w) <= 1, "MAVSDK: quaternion")
    action = Action(system)
    action.arm()
    armed = telemetry.armed() or wait(telemetry.armed)
    # Whatever has failed, the vehicle is not left armed.
    action.disarm()
    check(armed, "MAVSDK: armed")
    check(wait(lambda: not telemetry.armed()), "MAVSDK: disarmed")


def wait(condition, patience_s=PATIENCE_S):
    end = time.time() + patience_s
    while time.time() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    checks = {"mavproxy": mavproxy, "mavsdk": mavsdk}
    for name in sys.argv[2:] or checks:
        checks[name](sys.argv[1])


if __name__ == "__main__":
    main()

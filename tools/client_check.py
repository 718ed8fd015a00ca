#!/usr/bin/env python3
"""The unmodified pymavlink against a vehicle: `tools/client_check.py PORT [SECONDS]`.

PORT is what `tvc rig --pty` prints, or a board's port; the drone must be at rest, its polarity checked (SRV_POLARITY 1).
Needs `pip install pymavlink pyserial`.
Connects, fetches every parameter, sets each to its own and to another value, asks for the version, synchronises clocks,
arms, disarms, then counts attitudes, one for every control step, for SECONDS (600). Ends with status 1 if anything is not
as it should be.
"""

import os
import statistics
import sys
import time

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil  # noqa: E402


def check(holds, what):
    print(("ok      " if holds else "FAILED  ") + what, flush=True)
    if not holds:
        sys.exit(1)


def answer(link, kind, seconds=5, condition=lambda message: True):
    end = time.time() + seconds
    while time.time() < end:
        message = link.recv_match(type=kind, blocking=True, timeout=0.5)
        if message is not None and condition(message):
            return message
    return None


def command(link, number, *params):
    padded = list(params) + [0] * (7 - len(params))
    link.mav.command_long_send(1, 1, number, 0, *padded)
    ack = answer(link, "COMMAND_ACK", condition=lambda m: m.command == number)
    return None if ack is None else ack.result


def parameters(link):
    link.mav.param_request_list_send(1, 1)
    found = {}
    while True:
        row = answer(link, "PARAM_VALUE", 3)
        if row is None:
            return found, False
        found[row.param_id] = row.param_value
        if len(found) == row.param_count:
            return found, True


def set_parameter(link, name, value):
    link.mav.param_set_send(1, 1, name.encode(), value, mavutil.mavlink.MAV_PARAM_TYPE_REAL32)
    row = answer(link, "PARAM_VALUE", condition=lambda m: m.param_id == name)
    return None if row is None else row.param_value


def attitudes(link, seconds):
    """Counts attitudes, those that the vehicle's clock shows to be missing, and frames missing by their numbers."""
    times = []
    link.mav_loss = 0
    beat = 0
    end = time.time() + seconds
    while time.time() < end:
        if time.time() > beat:
            link.mav.heartbeat_send(6, 8, 0, 0, 4)
            beat = time.time() + 1
        message = link.recv_match(type="ATTITUDE_QUATERNION", blocking=True, timeout=1)
        if message is not None:
            times.append(message.time_boot_ms)
    periods = [b - a for a, b in zip(times, times[1:])]
    span = (times[-1] - times[0]) / 1000 if times else 0
    # The clock has whole milliseconds: the median period is not exact, twice as long is told apart all the same.
    usual = statistics.median(periods) if periods else 1
    missing = sum(period > 1.7 * usual for period in periods)
    return len(times), missing + link.mav_loss, span


def main():
    port = sys.argv[1]
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 600
    link = mavutil.mavlink_connection(port, baud=115200, source_system=255, dialect="common")
    check(link.wait_heartbeat(timeout=10) is not None, "heartbeat")
    values, whole = parameters(link)
    check(whole, f"{len(values)} parameters fetched")
    for name, value in values.items():
        check(set_parameter(link, name, value) == value, f"{name} set to {value:g}")
    for name in ("PID_KP", "PID_KD"):
        other = 0.5 if values[name] != 0.5 else 0.625
        changed = set_parameter(link, name, other) == other
        back = set_parameter(link, name, values[name]) == values[name]
        check(changed, f"{name} set to {other}")
        check(back, f"{name} set back")
    check(set_parameter(link, "PID_KP", 1e6) == values["PID_KP"], "PID_KP out of range refused")
    link.mav.command_long_send(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    version = answer(link, "AUTOPILOT_VERSION")
    check(version is not None and version.uid != 0, "version, with the chip's serial number")
    print("        build id " + bytes(version.flight_custom_version).decode("ascii"))
    link.mav.timesync_send(0, 1)
    check(answer(link, "TIMESYNC", condition=lambda m: m.ts1 == 1) is not None, "clock")
    end = time.time() + 20
    result = None
    while result != 0 and time.time() < end:
        result = command(link, 400, 1)
        time.sleep(0.3)
    is_armed = answer(link, "HEARTBEAT", condition=lambda m: m.base_mode & 128) is not None
    # Whatever has failed, the vehicle is not left armed.
    disarmed = command(link, 400, 0) == 0
    check(result == 0, "armed")
    check(is_armed, "armed flag")
    check(disarmed, "disarmed")
    count, lost, span = attitudes(link, seconds)
    check(count > 0 and lost == 0, f"{count} attitudes over {span:.1f} s, {lost} control steps without one")


if __name__ == "__main__":
    main()

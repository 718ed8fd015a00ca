#!/usr/bin/env python3
"""Frames that the firmware must send and understand, byte for byte as pymavlink makes them.

Writes tests/data/golden_frames.txt, a name and a frame in hexadecimal a line. Needs `pip install pymavlink` (made with
2.4.50). The values are those of the snapshot in src/telemetry/tests.rs.
"""

import os
import pathlib

os.environ["MAVLINK20"] = "1"

from pymavlink.dialects.v10 import common as mavlink1  # noqa: E402
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402
from pymavlink.dialects.v20 import development  # noqa: E402

OUT = pathlib.Path(__file__).parent.parent / "tests" / "data" / "golden_frames.txt"


def frame(message, sequence, source=(1, 1), dialect=mavlink, key=None):
    link = dialect.MAVLink(None, *source)
    link.seq = sequence
    if key is not None:
        link.signing.sign_outgoing = True
        link.signing.secret_key = key
        link.signing.timestamp = 1000
        link.signing.link_id = 1
    return bytes(message.pack(link)).hex()


def arm(dialect):
    return dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def frames():
    step = [
        ("statustext_clock", mavlink.MAVLink_statustext_message(4, b"clock: raw, up to 3 % off without USB")),
        ("heartbeat_active", mavlink.MAVLink_heartbeat_message(9, 0, 128 | 16 | 1, 4, 4, 3)),
        ("current_mode_active", development.MAVLink_current_mode_message(0, 4, 0)),
        ("statustext", mavlink.MAVLink_statustext_message(6, b"active")),
        (
            "attitude_quaternion",
            mavlink.MAVLink_attitude_quaternion_message(1234, 0.5, -0.5, 0.5, -0.5, 0.25, -1.5, 0.125),
        ),
        ("servo_output_raw", mavlink.MAVLink_servo_output_raw_message(1240001, 0, 1524, 0, 0, 0, 0, 0, 0, 0)),
        (
            "raw_imu",
            mavlink.MAVLink_raw_imu_message(1234567, 1, -2, -981, 16, -32, 48, 800, -16, 0x1234),
        ),
        ("named_value_float", mavlink.MAVLink_named_value_float_message(1234, b"crank", -0.375)),
        ("heartbeat_again", mavlink.MAVLink_heartbeat_message(9, 0, 128 | 16 | 1, 4, 4, 3)),
        (
            "sys_status",
            mavlink.MAVLink_sys_status_message(
                0x10200807, 0x10200807, 0x10300807, 123, 65535, -1, -1, 0, 0, 0, 5, 6, 7
            ),
        ),
        ("debug_vect", mavlink.MAVLink_debug_vect_message(b"imu_bus", 1240001, 4423, 4580, 100)),
        # Those of an estimate that has seen nothing: 2838 / 2^14 rad.
        ("tilt_sd", mavlink.MAVLink_named_value_float_message(1240, b"tilt_sd", 9.924646377563477)),
        ("head_sd", mavlink.MAVLink_named_value_float_message(1240, b"head_sd", 0)),
        ("gain", mavlink.MAVLink_named_value_float_message(1240, b"gain", 1)),
    ]
    for sequence, (name, message) in enumerate(step):
        yield name, frame(message, sequence)
    yield "log_entry", frame(mavlink.MAVLink_log_entry_message(0, 1, 0, 0, 11020), 5)
    yield "timesync_answer", frame(mavlink.MAVLink_timesync_message(1_500_000_000, 77), 5)
    yield "unknown_command_ack", frame(mavlink.MAVLink_command_ack_message(31999, 3, 0, 0, 255, 190), 5)
    host = (255, 190)
    yield "arm_v2", frame(arm(mavlink), 7, host)
    yield "arm_v1", frame(arm(mavlink1), 7, host, mavlink1)
    yield "arm_signed", frame(arm(mavlink), 7, host, key=bytes(range(32)))
    yield "timesync_request", frame(mavlink.MAVLink_timesync_message(0, 77), 7, host)
    yield "log_request_list", frame(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF), 8, host)
    yield "log_request_data", frame(mavlink.MAVLink_log_request_data_message(1, 1, 0, 90, 100), 9, host)
    yield "log_request_end", frame(mavlink.MAVLink_log_request_end_message(1, 1), 10, host)
    yield "arm_int", frame(mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0), 7, host)
    yield "ping", frame(mavlink.MAVLink_ping_message(1_234_567_890, 9, 0, 0), 7, host)
    yield "ping_answer", frame(mavlink.MAVLink_ping_message(1_234_567_890, 9, *host), 5)
    for name, kind in [("mission", 0), ("fence", 1), ("rally", 2)]:
        yield f"{name}_request_list", frame(mavlink.MAVLink_mission_request_list_message(1, 1, kind), 7, host)
        yield f"{name}_count", frame(mavlink.MAVLink_mission_count_message(*host, 0, kind), 5)
        yield f"{name}_clear", frame(mavlink.MAVLink_mission_clear_all_message(1, 1, kind), 7, host)
        yield f"{name}_cleared", frame(mavlink.MAVLink_mission_ack_message(*host, 0, kind), 5)
        yield f"{name}_upload", frame(mavlink.MAVLink_mission_count_message(1, 1, 300, kind), 7, host)
        yield f"{name}_refused", frame(mavlink.MAVLink_mission_ack_message(*host, 3, kind), 5)
    yield "param_set", frame(mavlink.MAVLink_param_set_message(1, 1, b"PID_KP", 1.6, 9), 9, host)
    yield "param_value", frame(mavlink.MAVLink_param_value_message(b"PID_KP", 1.6, 9, 106, 0), 5)
    yield "param_unknown", frame(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1), 7, host)
    yield "param_error", frame(mavlink.MAVLink_param_error_message(*host, b"NO_SUCH", -1, 1), 5)
    yield "message_interval", frame(mavlink.MAVLink_message_interval_message(1, 1_000_000), 5)
    mode = development.MAVLink_available_modes_message(18, 3, 0, 2, 2, b"standby")
    yield "available_mode", frame(mode, 5, dialect=development)
    yield "current_mode", frame(development.MAVLink_current_mode_message(0, 0x105, 0), 5, dialect=development)
    yield "unknown_command", frame(
        mavlink.MAVLink_command_long_message(1, 1, 31999, 0, 1, 0, 0, 0, 0, 0, 0), 12, host
    )


if __name__ == "__main__":
    OUT.write_text("".join(f"{name} {text}\n" for name, text in frames()))
    print(f"wrote {OUT}")

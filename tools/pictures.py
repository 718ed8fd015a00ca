#!/usr/bin/env python3
"""Draw docs/tick.svg, pid/step.svg and fusion/error.svg from what the image and the filters do.

    pip install vqf numpy && python3 tools/pictures.py

The first two are of flights on the rig (rig/examples/pictures.rs). The third has the error of the VQF class and of VQF
itself (D. Laidig, T. Seel, Information Fusion 91, 2023) on tests/data/broad_11_cut.imuq.
Exit status: 0 written, 1 a command failed (the old pictures stay).
"""

import csv
import math
import pathlib
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
RECORDING = ROOT / "tests" / "data" / "broad_11_cut.imuq"
WIDTH, LEFT, RIGHT, TOP, BOTTOM = 860, 84, 20, 34, 48
BLUE, ORANGE, GREEN, GREY = "#0d5ba6", "#c8590c", "#1b7f5c", "#555"
# Time over which an error is averaged before it is drawn, s.
AVERAGED_S = 0.25


class Failed(Exception):
    """A command that gave no data."""


def run(*command):
    result = subprocess.run(list(map(str, command)), cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if result.returncode:
        raise Failed(f"`{' '.join(map(str, command))}` ended with status {result.returncode}")
    return result.stdout


def flown(what):
    """The rows of `rig/examples/pictures.rs`."""
    text = run("cargo", "run", "--quiet", "--profile", "tool", "-p", "rig", "--example", "pictures", "--", what)
    return list(csv.DictReader(text.splitlines()))


def words(x, y, text, anchor="middle", colour="#222", more=""):
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" {more}>{text}</text>'


def svg(height, parts):
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" ' \
           'font-family="sans-serif" font-size="13">'
    return "\n".join([head, f'<rect width="{WIDTH}" height="{height}" fill="white"/>', *parts, "</svg>", ""])


def time_axis(until, step, unit, bottom):
    """The function from time to x, and the axis: lines of the grid with their numbers."""
    def x(time):
        return LEFT + (WIDTH - LEFT - RIGHT) * time / until
    parts = []
    for index in range(int(until / step + 1.5)):
        at = x(index * step)
        parts.append(f'<path d="M{at:.1f} {TOP}V{bottom}" stroke="#ddd"/>')
        parts.append(words(at, bottom + 17, f"{index * step:g}"))
    return x, [*parts, words(x(until / 2), bottom + 36, f"time, {unit}")]


def lines_over_time(lines, until, step, levels, quantity):
    """A picture of lines: name, colour and points of each; `levels` are the numbers of the other axis."""
    bottom = TOP + 240
    x, parts = time_axis(until, step, "s", bottom)
    low, high = levels[0], levels[-1]

    def y(value):
        return bottom - (bottom - TOP) * (value - low) / (high - low)
    for level in levels:
        parts += [f'<path d="M{LEFT} {y(level):.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>',
                  words(LEFT - 8, y(level) + 4, f"{level:g}", "end")]
    parts.append(words(24, (TOP + bottom) / 2, quantity, more=f'transform="rotate(-90 24 {(TOP + bottom) / 2:.0f})"'))
    for index, (name, colour, points) in enumerate(lines):
        path = " ".join(f"{x(time):.1f},{y(value):.1f}" for time, value in points if time <= until)
        parts += [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>',
                  words(WIDTH - RIGHT, 22, name, "end", colour) if index == 0 else
                  words(LEFT, 22, name, "start", colour)]
    return svg(bottom + BOTTOM, parts)


def tick():
    rows = flown("ticks")
    lanes = [("sensor bus", ["burst", "rates"], BLUE), ("step", ["step"], ORANGE), ("servo pulse", ["pulse"], GREEN)]
    height, bottom = 44, TOP + 3 * 44
    x, parts = time_axis(40, 5, "ms, from the rising edge of a pulse", bottom)
    for lane, (name, kinds, colour) in enumerate(lanes):
        top = TOP + lane * height + 10
        parts.append(words(LEFT - 8, top + 18, name, "end"))
        for row in (row for row in rows if row["what"] in kinds):
            start, end = max(float(row["start_ms"]), 0), min(float(row["end_ms"]), 40)
            wide = max(x(end) - x(start), 2)
            parts.append(f'<rect x="{x(start):.1f}" y="{top}" width="{wide:.1f}" height="26" rx="2" fill="{colour}"/>')
            said = {"burst": "all", "rates": "rates"}.get(row["what"])
            if said and wide > 30:
                parts.append(words(x((start + end) / 2), top + 18, said, colour="white"))
    parts.append(words(LEFT, 22, "Two servo frames of 50 Hz in a flight. The last step of a frame decides the next pulse.",
                       "start", GREY))
    return svg(bottom + BOTTOM, parts)


def step():
    rows = flown("laws")

    def points(law):
        return [(float(row["time_s"]), float(row["pitch_deg"])) for row in rows if row["law"] == law]
    lines = [("switching surface, the default", BLUE, points("switching surface")),
             ("PD, gains of the thesis", ORANGE, points("PD"))]
    return lines_over_time(lines, 1.5, 0.25, [-5, 0, 5, 10, 15, 20, 25], "pitch, deg")


def recording():
    """Rate, samples and references of an IMUQ16v1 file, in SI units; the layout is in recordings/src/imuq.rs."""
    data = RECORDING.read_bytes()
    count, rate, gyr, acc, mag, quaternion, _ = struct.unpack_from("<I5fI", data, 8)
    rows = list(struct.iter_unpack("<14h", data[64:64 + 28 * count]))
    return rate, [([value * gyr for value in row[0:3]], [value * acc for value in row[3:6]],
                   [value * mag for value in row[6:9]], [value * quaternion for value in row[9:13]], row[13])
                  for row in rows]


def total_deg(estimate, reference):
    """Angle of the rotation between two quaternions, deg."""
    norm = math.hypot(*estimate) * math.hypot(*reference)
    cos = abs(sum(a * b for a, b in zip(estimate, reference))) / norm
    return math.degrees(2 * math.acos(min(cos, 1)))


def error():
    import numpy
    from vqf import VQF
    rate, samples = recording()
    columns = [numpy.ascontiguousarray([sample[index] for sample in samples]) for index in range(3)]
    published = VQF(1 / rate).updateBatch(*columns)["quat9D"]
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "estimates.csv"
        run("cargo", "tvc", "fuse", RECORDING, "--out", out)
        own = [[float(row[axis]) for axis in "wxyz"] for row in csv.DictReader(out.read_text().splitlines())]
    block = round(AVERAGED_S * rate)

    def line(name, colour, estimates):
        errors = [total_deg(estimate, sample[3]) if sample[4] == 3 else None
                  for estimate, sample in zip(estimates, samples)]
        counted = [value for value in errors if value is not None]
        rms = math.sqrt(sum(value ** 2 for value in counted) / len(counted))
        points = []
        for start in range(0, len(errors) - block, block):
            part = [value for value in errors[start:start + block] if value is not None]
            if part:
                points.append(((start + block / 2) / rate, math.sqrt(sum(value ** 2 for value in part) / len(part))))
        return f"{name}: {rms:.2f} deg RMS", colour, points
    lines = [line("VQF class, this crate", BLUE, own), line("VQF 2.1.2", ORANGE, published)]
    return lines_over_time(lines, len(samples) / rate, 10, [0, 0.5, 1, 1.5, 2], "total error, deg")


def main():
    try:
        pictures = {"docs/tick.svg": tick(), "pid/step.svg": step(), "fusion/error.svg": error()}
    except Failed as failure:
        sys.exit(f"error: {failure}; the pictures are as they were")
    except ImportError as missing:
        sys.exit(f"error: {missing}; `pip install vqf numpy`")
    for name, text in pictures.items():
        (ROOT / name).with_suffix(".new").write_text(text, encoding="utf-8")
        (ROOT / name).with_suffix(".new").replace(ROOT / name)
        print(name)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(__doc__)
        sys.exit(0 if sys.argv[1] in ("-h", "--help") else 2)
    main()

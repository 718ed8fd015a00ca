#!/usr/bin/env python3
"""The tables of the filters' documents: scores on recordings, with clipped rates and offline, and what an update costs.

    python3 tools/filter_tables.py --broad FOLDER    with the seven recordings of BROAD as IMUQ16v1 files

Each table stands between two comments with its name. Without --broad only the costs are written. Needs the tool built
(`cargo build -p ground -p lab --profile tool`); takes about two minutes.
"""

import argparse
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCUMENTS = [ROOT / "fusion" / "README.md", ROOT / "fusion" / "docs" / "measured.md"]
TOOLS = ROOT / "target" / "tool"
HEADER, RECORD = 64, 28

FILTERS = [
    ("integrated gyro", "gyro", "f32"),
    ("complementary", "complementary", "f32"),
    ("Mahony", "mahony", "f32"),
    ("Madgwick", "madgwick", "f32"),
    ("VQF class", "vqf", "f32"),
    ("Kalman", "kalman", "f32"),
    ("complementary, fixed point", "complementary", "fixed"),
    ("Mahony, fixed point", "mahony", "fixed"),
    ("Madgwick, fixed point", "madgwick", "fixed"),
    ("VQF class, fixed point", "vqf", "fixed"),
]
COSTS = [
    ("Mahony, `f32`", "mahony", "f32"),
    ("VQF class, `f32`", "vqf", "f32"),
    ("Kalman, `f32`", "kalman", "f32"),
    ("Mahony, fixed point", "mahony", "fixed"),
    ("VQF class, fixed point", "vqf", "fixed"),
    ("complementary, fixed point", "complementary", "fixed"),
    ("Madgwick, fixed point", "madgwick", "fixed"),
]
# Recording and limit of its rates, deg/s.
CLIPPED = [
    ("broad_08", 1000),
    ("broad_08", 800),
    ("broad_08", 422),
    ("broad_03", 200),
    ("broad_16", 422),
    ("broad_24", 300),
    ("broad_34", 200),
]


def told(program, *arguments):
    """The JSON object that `tvc` or `lab` prints."""
    done = subprocess.run([TOOLS / program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{program} {' '.join(map(str, arguments))}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def mean(files, *options):
    return told("tvc", "fuse", "--score", "--json", *options, *files)["mean"]


def all_three(score):
    return " / ".join(f"{score[key]:.3f}" for key in ("total_deg", "heading_deg", "inclination_deg"))


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def scores(files):
    """The table of all filters, and that of a few."""
    rows = []
    few = [["VQF 2.1.2, gyroscope lag compensated", "1.953", "0.631"]]
    for name, filter_, scalar in FILTERS:
        of = ["--filter", filter_, "--scalar", scalar]
        full, tilt = mean(files, *of), mean(files, *of, "--mode", "6d")
        rows.append([name, all_three(full), f"{tilt['inclination_deg']:.3f}"])
        if filter_ in ("mahony", "vqf"):
            few.append([name, *(f"{full[key]:.3f}" for key in ("total_deg", "inclination_deg"))])
    return table(["filter", "9D", "6D inclination"], rows), table(["filter", "total", "inclination"], few)


def offline(files):
    rows = []
    for name, filter_, scalar in FILTERS[1:6]:
        of = ["--offline", "--filter", filter_, "--scalar", scalar]
        name = name if filter_ != "vqf" else "VQF class, `VqfGains::offline`"
        tilt = mean(files, *of, "--mode", "6d")
        rows.append([name, all_three(mean(files, *of)), f"{tilt['inclination_deg']:.3f}"])
    return table(["filter", "9D", "6D inclination"], rows)


def clipped_copy(file, limit_deg_s, to):
    """The recording with its rates clipped; the share of the movement's samples that are."""
    data = bytearray(file.read_bytes())
    (per_count,) = struct.unpack_from("<f", data, 16)
    limit = int(limit_deg_s * 3.141592653589793 / 180.0 / per_count)
    hit = moving = 0
    for at in range(HEADER, len(data), RECORD):
        rates = struct.unpack_from("<3h", data, at)
        (flags,) = struct.unpack_from("<h", data, at + 26)
        struct.pack_into("<3h", data, at, *(max(-limit, min(limit, rate)) for rate in rates))
        moving += flags & 1
        hit += (flags & 1) and any(abs(rate) > limit for rate in rates)
    to.write_bytes(data)
    return hit / moving


def clipping(files):
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, limit in CLIPPED:
            file = next(file for file in files if file.name.startswith(name))
            copy = pathlib.Path(folder) / file.name
            share = clipped_copy(file, limit, copy)
            total = mean([copy], "--scalar", "f32")["total_deg"]
            rows.append([f"{name}, {limit} deg/s", f"{100 * share:.0f} %", f"{total:.1f}"])
    return table(["recording, limit", "clipped samples of the movement", "9D total"], rows)


def costs():
    names = [f"--filter={name}" for name in sorted({filter_ for _, filter_, _ in COSTS})]
    found = told("lab", "cycles", "--json", "--library", "tvc-fusion", *names)["filters"]
    rows = []
    for name, filter_, scalar in COSTS:
        [cost] = [row for row in found if (row["filter"], row["mode"], row["scalar"]) == (filter_, "9d", scalar)]
        rows.append([name, *(f"{cost[key]:,.0f}" for key in ("cycles_mean", "cycles_max", "code_bytes"))])
    return table(["filter", "mean", "maximum", "code, bytes"], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--broad", type=pathlib.Path, metavar="FOLDER", help="the seven recordings")
    folder = parser.parse_args().broad
    tables = {"costs": costs()}
    if folder is not None:
        files = sorted(folder.glob("broad_*.imuq"))
        if len(files) != 7:
            sys.exit(f"{folder} has {len(files)} recordings named broad_*.imuq, not seven")
        tables["scores"], tables["summary"] = scores(files)
        tables |= {"offline": offline(files), "clipped": clipping(files)}
    texts = {document: document.read_text() for document in DOCUMENTS}
    for name, lines in tables.items():
        place = re.compile(rf"<!-- {name} -->\n.*?\n<!-- end of {name} -->", re.DOTALL)
        document = next((document for document in DOCUMENTS if place.search(texts[document])), None)
        if document is None:
            sys.exit(f"no document has a place for the table named {name}")
        table_here = f"<!-- {name} -->\n{lines}\n<!-- end of {name} -->"
        texts[document] = place.sub(lambda _: table_here, texts[document])
    for document, text in texts.items():
        document.write_text(text)
        print(f"wrote {document}")


if __name__ == "__main__":
    main()

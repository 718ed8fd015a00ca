#!/usr/bin/env python3
"""Write docs/reference/measurements.md, docs/flight.svg and the filters' tables anew: every figure comes from a
command of the tools run with --json, and the picture from the report of a flight.

    python3 tools/measurements.py --broad FOLDER     all sections; takes 75 minutes on two cores
    python3 tools/measurements.py --without-broad    leaves the scores on the BROAD recordings as they are

FOLDER holds IMUQ16v1 recordings (.imuq) of the BROAD data set. The commands run through `cargo tvc`, so the tool
and the image are built from this checkout. Run it on an idle machine: the speed of the emulation is a time.
Exit status: 0 written, 1 a command failed (the old page stays).
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "measurements.md"
PICTURE = ROOT / "docs" / "flight.svg"
SEEDS = 48
SERVOS = {"s3003": "S3003", "digital": "digital"}


class Failed(Exception):
    """A command that gave no figures."""


def tvc(*arguments, program="tvc"):
    """The JSON object that `tvc ARGUMENTS --json` prints. Status 1 is a missed requirement and still has figures."""
    command = ["cargo", program, *map(str, arguments), "--json"]
    print(" ".join(command), file=sys.stderr, flush=True)
    result = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if result.returncode not in (0, 1) or not result.stdout.strip():
        raise Failed(f"`{' '.join(command)}` ended with status {result.returncode}")
    return json.loads(result.stdout)


def built():
    """Commit, compiler and machine of all figures."""
    def said(*command):
        return subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()

    changed = " with changes" if said("git", "status", "--porcelain", "--untracked-files=no") else ""
    return f"commit `{said('git', 'rev-parse', '--short=8', 'HEAD')}`{changed}, {said('rustc', '--version')}"


def lab(*arguments):
    """As `tvc`, of `lab`."""
    return tvc(*arguments, program="lab")


def table(head, rows):
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)


def flights(scratch):
    """Step responses of the image on the rig, and the loop's own figures; and the picture of a flight."""
    rows = []
    report = scratch / "fly.html"
    for servo, name in SERVOS.items():
        starts = tvc("fly", "--servo", servo, "--seeds", SEEDS, "--report", report)["distribution"]

        def three(key, form, starts=starts):
            return [" / ".join(form.format(start[key][of]) for start in starts) for of in ("mean", "p95", "worst")]

        rows.append([f"{name}: times the time-optimal limit", *three("ratio", "{:.2f}")])
        rows.append([f"{name}: overshoot, %", *three("overshoot_pct", "{:.1f}")])
        rows.append([f"{name}: 5 % settling, s", *three("settling_5pct_s", "{:.3f}")])
        rows.append([f"{name}: left after settling, mrad", *three("residual_mrad", "{:.1f}")])
    head = ["from 0.2 / 0.4 / 0.8 rad with 0.2 rad/s", "mean", "95 %", "worst"]
    text = f"## Flights\n`cargo tvc fly --servo SERVO --seeds {SEEDS} --json`: {SEEDS} flights from each tilt, to either " \
           "side in turn. The time-optimal limit is bang-bang control with the rudder's speed limited, without delay " \
           "and lag. Required of 95 % of the flights: 1.25 times the limit (S3003) and 1.2 (digital), overshoot 2 %; of " \
           "the worst: 1.32 times, 3.5 %.\n\n"
    tick = lab("profile", "--wait-states", 0, "--report", scratch / "profile.html")
    loop = the_loop(tvc("fly", "--report", report), tick["cycles_per_tick"], lab("stack"))
    return text + table(head, rows) + "\n" + loop, flight_picture(report.read_text(encoding="utf-8"))


def flight_picture(report):
    """The last flight of a report, from the largest start: its two plots, one below the other, as one picture."""
    plots = re.findall(r"<svg[^>]*>.*?</svg>", report, re.DOTALL)[-2:]
    sizes = [re.match(r'<svg width="(\d+)" height="(\d+)"', plot) for plot in plots]
    if len(plots) != 2 or not all(sizes):
        raise Failed("the report of `tvc fly` has no two plots of known size")
    (width, upper), (_, lower) = [map(int, size.groups()) for size in sizes]
    size = f'width="{width}" height="{upper + lower}" viewBox="0 0 {width} {upper + lower}"'
    below = plots[1].replace("<svg ", f'<svg y="{upper}" ', 1)
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{plots[0]}\n{below}\n</svg>\n'


def the_loop(flight, tick_cycles, stack):
    """The control loop's timing and memory, of one flight; and the cycles from tick to tick, by the profile."""
    loop, image, speed = flight["loop"], flight["image"], flight["emulation"]
    rows = [
        ["control rate", f"{loop['rate_hz']:.1f} Hz", "100 Hz"],
        ["worst jitter", f"{loop['jitter_us_max']:.1f} us", "100 us"],
        ["burst start to the edge of its pulse, mean", f"{flight['latency_us']['mean'] / 1e3:.2f} ms", "8 ms"],
        ["age of the sample when its burst begins, mean", f"{flight['sample_age_us']['mean'] / 1e3:.2f} ms", ""],
        ["cycles a step, 0 wait states, mean / worst",
         f"{loop['cycles_per_step_mean']:,.0f} / {loop['cycles_per_step_max']:,}", ""],
        ["cycles a tick with telemetry streaming, all that runs, 0 wait states", f"{tick_cycles:,.0f}", ""],
        ["core awake, 1 wait state", f"{100 * loop['cpu_load']:.1f} %", ""],
        ["flash", f"{image['flash_bytes']:,} bytes", "102,400 bytes"],
        ["stack, worst case",
         f"{stack['worst_bytes']:,} of {stack['room_bytes']:,} bytes ({stack['share_pct']:.1f} %)", "60 %"],
        [f"emulation on a machine with {os.cpu_count()} cores",
         f"{speed['real_time_factor']:.1f} x real time; {speed['busy_real_time_factor']:.1f} x while the core is awake",
         ""],
    ]
    return "## The loop\n`cargo tvc fly --seed 1 --json`, S3003, `cargo lab profile --wait-states 0 --json` and `cargo lab stack --json`.\n\n" + table(["", "measured", "required"], rows)


def control_law(scratch):
    """The shipped gains on the model: predicted figures, and margins."""
    shipped = scratch / "shipped.param"
    shipped.write_text("PID_LAW 2\n")
    rows = []
    for servo, name in SERVOS.items():
        tuned = tvc("tune", "--servo", servo, "--params", shipped, "--generations", 0, "--flights", 0)
        margins = tuned["margins"]

        def triple(key, of, form, runs=tuned["runs"]):
            return " / ".join(form.format(run[key][of]) for run in runs)

        rows.append([
            name,
            triple("ratio", "mean", "{:.2f}"),
            triple("ratio", "p95", "{:.2f}"),
            triple("overshoot_pct", "p95", "{:.1f}") + " %",
            f"{tuned['slow_overshoot_pct']:.1f} %",
            f"{margins['gain_db']:.1f} / {margins['quiet_db']:.1f} dB",
            f"{1e3 * margins['delay_s']:.0f} ms",
            f"{margins['peak_sensitivity']:.1f}",
        ])
    head = ["from 0.1 to 0.3 / to 0.6 / to 0.85 rad, by the model", "times the limit, mean", "95 %", "overshoot, 95 %",
            "with a sensor at 35 Hz, worst", "gain until lost / until 5 mrad", "delay margin", "peak sensitivity"]
    text = "## Control law\n`cargo tvc tune --servo SERVO --params FILE --generations 0 --flights 0 --json` with the shipped gains: 140 " \
           "flights from each group of tilts, and [margins](../explanation/control.md) measured by flights of the model.\n\n"
    return text + table(head, rows)


def monte_carlo(scratch):
    """Dispersed drones on the model."""
    rows = []
    wider = ["--spread", "thrust=0.2,inertia=0.2,servo_speed=0.25,delay_ms=5"]
    for servo, name in SERVOS.items():
        for what, options in [
            ("", []),
            (", off centre", ["--lateral-mm", 5]),
            (", wide", wider),
        ]:
            runs = tvc("montecarlo", "-n", 2000, "--servo", servo, *options, "--report", scratch / "montecarlo.html",
                       "--worst", scratch / "worst")
            share = [f"{100 * runs[key]:.2f} %" for key in ("pass_rate", "pass_rate_low", "pass_rate_high")]
            rows.append([f"{name}{what}", share[0], f"{share[1]} to {share[2]}"])
    head = ["2,000 dispersed drones", "within 30 % and 1.5 s", "95 % bounds"]
    return ("## Monte Carlo\n`cargo tvc montecarlo -n 2000 --servo SERVO --json`; *off centre* with `--lateral-mm 5`, "
            f"*wide* with `{' '.join(wider)}`.\n\n" + table(head, rows))


def faults(scratch):
    """Faults in mid-flight, and what fails beyond the sensor in the vehicle's other phases."""
    campaign = lab("faults", "--report", scratch / "faults.html")
    kinds = campaign["faults"]
    total = {key: sum(kind[key] for kind in kinds) for key in ("runs", "recovered", "neutral", "restarted", "unmodelled", "unsafe")}
    slowest = max(kinds, key=lambda kind: kind["worst_ms"])
    elsewhere = [kind for phase in ("start", "standby", "saving", "armed", "failsafe")
                 for kind in lab("faults", "--phase", phase, "--report", scratch / "phase.html")["faults"]]
    runs, unsafe = (sum(kind[key] for kind in elsewhere) for key in ("runs", "unsafe"))
    glitches = lab("faults", "--glitches", "--report", scratch / "glitches.html")["faults"]
    ridden, all_glitches = (sum(kind[key] for kind in glitches) for key in ("recovered", "runs"))
    return (f"## Faults\n`cargo lab faults --json`: {total['runs']:,} faults of {len(kinds)} kinds in mid-flight. "
            f"{total['recovered']:,} recovered, {total['neutral']:,} ended with the neutral pulse commanded, "
            f"{total['restarted']:,} behind a reset, {total['unmodelled']:,} in what the chip's model lacks, "
            f"{total['unsafe']:,} were unsafe. The longest without control took "
            f"{slowest['worst_ms']:.0f} ms (`{slowest['kind']}`). Faults of the sensor may take "
            f"{campaign['deadline_ms']:.0f} ms, the others {campaign['wrong_limit_ms']:.0f} ms. Of flipped bits and "
            f"failing peripherals {campaign['upset_noticed_pct']:.0f} % were noticed and "
            f"{campaign['upset_harmless_pct']:.0f} % harmless.\n\n"
            f"In the other five phases (`--phase`) {unsafe} of {runs:,} were unsafe. `cargo lab faults --glitches --json`: the "
            f"vehicle kept control in {ridden} of {all_glitches} glitches of 4 to 40 ms.\n")


def two_axes(scratch):
    """The drone with two rudders, and vehicles of both kinds that differ from their parameters."""
    rows, steps = [], []
    for servo, title in SERVOS.items():
        flown = tvc("fly", "--vehicle", "drone2", "--servo", servo, "--seeds", 12, "--report", scratch / "two.html")
        steps.append(flown["loop"])
        for tilt in dict.fromkeys(start["start_rad"] for start in flown["starts"]):
            starts = [start for start in flown["starts"] if start["start_rad"] == tilt]
            coupled = max(start["cross_coupling_pct"] or 0 for start in starts)
            rows.append([title, f"{tilt:.1f} rad",
                         " / ".join(f"{start['overshoot_pct']:.1f}" for start in starts) + " %",
                         " / ".join(f"{start['settling_5pct_s']:.3f}" for start in starts) + " s", f"{coupled:.1f} %"])
    dispersed = []
    for vehicle in ("drone", "drone2"):
        flown = tvc("fly", "--vehicle", vehicle, "--dispersed", 500, "--report", scratch / "dispersed.html")
        dispersed.append(f"{flown['within_pct']:.2f} % of 500 vehicles like `{vehicle}`")
    kinds = lab("faults", "--vehicle", "drone2", "--report", scratch / "faults2.html")["faults"]
    runs, unsafe = (sum(kind[key] for kind in kinds) for key in ("runs", "unsafe"))
    head = ["servos", "tilt in pitch / roll / both", "overshoot, worst", "5 % settling, worst", "cross coupling, worst"]
    return ("## Two axes\n`cargo tvc fly --vehicle drone2 --servo SERVO --seeds 12 --json`: each start at headings of 0, 90 "
            "and 135 deg, without spin and with 1 rad/s. Required: overshoot 5 %, cross coupling 10 %.\n\n" + table(head, rows) +
            f"\nA step of both axes takes {steps[0]['cycles_per_step_mean']:,.0f} cycles without wait states, "
            f"{steps[0]['cycles_per_step_max']:,.0f} at worst. Of the image flown with `--dispersed 500`, "
            f"{' and '.join(dispersed)} came upright within 30 % and 1.5 s; 99 % are required. `cargo lab faults --vehicle drone2`: "
            f"{unsafe} of {runs:,} were unsafe.\n")


def rocket(scratch):
    """A rocket through its burn, and rockets that are not as their images were told."""
    flown = tvc("fly", "--vehicle", "rocket", "--seeds", 12, "--report", scratch / "rocket.html")
    rows = [[case["case"], f"{case['error_rms_mean_deg']:.2f} / {case['error_rms_deg']:.2f}",
             f"{case['error_max_deg']:.1f}", f"{case['error_end_deg']:.2f}",
             "yes" if case["in_control"] and case["neutral_after_burnout"] else "no"]
            for case in flown["cases"]]
    dispersed = tvc("fly", "--vehicle", "rocket", "--dispersed", 500, "--report", scratch / "rockets.html")
    margins = tvc("model", "margins", "--dispersed", 500)
    kept = [[row["airframe"], f"{row['at_s']:.1f} s", f"+{row['more_db']:.1f} / -{row['less_db']:.1f} dB",
             f"{row['phase_deg']:.0f} deg", f"{row['crossover_rad_s']:.1f} rad/s"] for row in margins["nominal"]]
    head = ["airframe, control", "error rms, mean / worst, deg", "largest, deg", "at burnout, deg",
            "in control, then neutral"]
    return ("## Rocket\n`cargo tvc fly --vehicle rocket --seeds 12 --json`: the true angle of the axis from the vertical, "
            "from 2 s after the launch was seen to burnout ([the conditions](../guides/rocket.md)). Required: 2 deg rms, 4 deg at burnout. "
            "The gyroscope's offset shifts by 0.1 deg/s for each g.\n\n" + table(head, rows) +
            f"\nOf 500 rockets that differ from what their images were told (`--dispersed 500`), "
            f"{dispersed['within_pct']:.2f} % met the requirements and stayed in control; 99 % are required.\n\n"
            "`cargo tvc model margins --dispersed 500 --json`: gain and delay are raised in the simulation until the "
            "rocket is lost, by 20 dB at most. Required: 6 dB and 30 deg.\n\n" +
            table(["airframe", "time of the burn", "gain", "phase margin", "crossover"], kept) +
            f"\n{margins['dispersed_pct']:.1f} % of 500 dispersed rockets keep 4 dB and 20 deg throughout; 99 % are required.\n")


def hardware(scratch):
    """Parts that differ; docs/reference/hardware.md has the table."""
    campaign = lab("hardware", "--report", scratch / "hardware.html")
    rows = campaign["rows"]
    expected = sum(row["as_expected"] for row in rows)
    flown = [row for row in rows if row["ended"] == "flies"]
    worst = {key: max(row[key] for row in flown)
             for key in ("overshoot_pct", "settling_s3003_s", "settling_digital_s", "latency_us", "jitter_us_max")}
    return (f"## Parts that differ\n`cargo lab hardware --json`: {len(rows)} settings of sensor, bus, chip and computer, "
            f"six flights each; [the table](hardware.md#what-was-flown). {expected} ended as expected, and {len(flown)} "
            f"met every requirement: overshoot at most {worst['overshoot_pct']:.1f} %, settling "
            f"{worst['settling_s3003_s']:.3f} s (S3003) and {worst['settling_digital_s']:.3f} s (digital), latency "
            f"{worst['latency_us'] / 1e3:.2f} ms, jitter {worst['jitter_us_max']:.1f} us.\n")


def replays(scratch, broad):
    """Recordings through the whole image."""
    files = [ROOT / "tests" / "data" / "broad_11_cut.imuq"]
    files += sorted(path for name in ("broad_03*", "broad_11*") for path in broad.glob(name)) if broad else []
    rows = []
    for path in files:
        score = tvc("fly", "--recording", path, "--report", scratch / "replay.html")["replay"]
        rows.append([f"`{path.stem}`", f"{score['total_deg']:.2f} deg", f"{score['heading_deg']:.2f} deg",
                     f"{score['inclination_deg']:.2f} deg",
                     f"{score['steps_equal']:,} of {score['steps_compared']:,}"])
    head = ["recording", "total", "heading", "inclination", "quaternions equal to the host library's, bit for bit"]
    return "## Recordings through the image\n`cargo tvc fly --recording FILE --json`.\n\n" + table(head, rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--broad", type=pathlib.Path, metavar="FOLDER", help="BROAD recordings (.imuq)")
    source.add_argument("--without-broad", action="store_true", help="leave out the scores on BROAD recordings")
    options = parser.parse_args()
    if options.broad and not list(options.broad.glob("*.imuq")):
        parser.error(f"{options.broad} holds no .imuq file")
    broad = options.broad.resolve() if options.broad else None
    head = ("# Measurements\n`python3 tools/measurements.py` runs the commands below and writes this page, and the "
            "[tables of the filters](../../fusion/docs/measured.md). Every figure is of the virtual rig and of one image: "
            f"{built()}. Nothing has run on a board yet.\n")
    try:
        with tempfile.TemporaryDirectory() as folder:
            scratch = pathlib.Path(folder)
            flown, picture = flights(scratch)
            sections = [flown, control_law(scratch), monte_carlo(scratch), faults(scratch), two_axes(scratch),
                        rocket(scratch), hardware(scratch), replays(scratch, broad)]
        tables = [sys.executable, ROOT / "tools" / "filter_tables.py", *(["--broad", broad] if broad else [])]
        if subprocess.run(tables, check=False).returncode:
            raise Failed("tools/filter_tables.py failed")
    except Failed as error:
        sys.exit(f"error: {error}; {PAGE.relative_to(ROOT)} is as it was")
    for path, text in [(PAGE, "\n".join([head, *sections])), (PICTURE, picture)]:
        fresh = path.with_suffix(".new")
        fresh.write_text(text, encoding="utf-8")
        fresh.replace(path)
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()

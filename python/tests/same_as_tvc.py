"""Holds the module to the tool: every line that `tvc fuse` writes, with every filter and scalar.

python tests/same_as_tvc.py TVC [RECORDING]

TVC is the program, such as ../target/debug/tvc.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import tvc_fusion

RECORDING = pathlib.Path(__file__).parents[2] / "tests" / "data" / "broad_11_cut.imuq"
FLOAT = ("gyro", "complementary", "mahony", "madgwick", "vqf", "kalman")
FIXED = ("complementary", "mahony", "madgwick", "vqf")

# Filter, scalar, mode, offline, settings.
CASES = [(name, scalar, mode, False, {}) for name in FLOAT for scalar in ("f32", "f64") for mode in ("6d", "9d")]
CASES += [(name, "fixed", mode, False, {}) for name in FIXED for mode in ("6d", "9d")]
CASES += [(name, "f32", "9d", True, {}) for name in FLOAT]
CASES += [("vqf", "f32", "9d", False, {"mag_tau_s": 6, "field.gate": "inf"})]


def lines(recording, estimates):
    """The table of `tvc fuse`, from the module's numbers."""
    yield "t,w,x,y,z"
    for time_s, q in zip(recording.time_s, estimates):
        time = repr(time_s).removesuffix(".0")
        yield ",".join([time] + [f"{c:.9f}" for c in q])


def check(tvc, path, recording, case, folder):
    name, scalar, mode, offline, settings = case
    out = pathlib.Path(folder) / "est.csv"
    command = [tvc, "fuse", path, "--filter", name, "--scalar", scalar, "--mode", mode, "--out", out, "--json"]
    command += ["--offline"] * offline
    for key, value in settings.items():
        command += ["--set", f"{key}={value}"]
    told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    estimates = recording.estimate(name, mode=mode, scalar=scalar, offline=offline, settings=settings)
    written = out.read_text().splitlines()
    assert len(written) == len(recording) + 1, f"{case}: {len(written)} lines for {len(recording)} samples"
    for number, (ours, theirs) in enumerate(zip(lines(recording, estimates), written, strict=True), 1):
        assert ours == theirs, f"{case}, line {number}: {ours} here, {theirs} of tvc fuse"
    _, _, inclination = recording.score(estimates)
    assert abs(inclination - told["mean"]["inclination_deg"]) < 1e-9, case


def check_streaming(recording):
    """Sample by sample is the same as the whole recording, no rate of which comes near the range."""
    estimator = tvc_fusion.Estimator("mahony", scalar="f64", period_s=recording.period_s)
    samples = zip(recording.time_s, recording.gyr_rad_s, recording.acc_m_s2, recording.mag_ut)
    live = [estimator.update(*sample) for sample in samples]
    assert live == recording.estimate("mahony", scalar="f64"), "sample by sample"


def check_errors():
    for wrong, said in (
        (lambda: tvc_fusion.Estimator("best"), "no filter best; there are gyro,"),
        (lambda: tvc_fusion.Estimator(settings={"no_such": 1}), "no setting no_such"),
        (lambda: tvc_fusion.Estimator("kalman", scalar="fixed"), "no fixed-point form"),
        (lambda: tvc_fusion.Recording(__file__), "neither an IMUQ16v1 recording nor a CSV file"),
    ):
        try:
            wrong()
        except ValueError as error:
            assert said in str(error), error
        else:
            raise AssertionError(f"not refused: {said}")
    try:
        tvc_fusion.Recording("no such file")
    except OSError:
        pass
    else:
        raise AssertionError("a missing file was read")


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__.strip())
    path = sys.argv[2] if len(sys.argv) == 3 else RECORDING
    recording = tvc_fusion.Recording(path)
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            check(sys.argv[1], path, recording, case, folder)
    check_streaming(recording)
    check_errors()
    print(f"{len(CASES)} runs of {len(recording)} samples are the same")


if __name__ == "__main__":
    main()

"""Draws roll, pitch and yaw of a recording beside its reference.

python example.py RECORDING [IMAGE]
"""

import math
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import tvc_fusion


def angles_deg(q):
    """Roll, pitch and yaw of a quaternion to east-north-up, deg; not a number without one."""
    if q is None:
        return (math.nan,) * 3
    w, x, y, z = q
    sine = max(-1.0, min(1.0, 2 * (w * y - x * z)))
    return (
        math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
        math.degrees(math.asin(sine)),
        math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
    )


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__.strip())
    recording = tvc_fusion.Recording(sys.argv[1])
    image = sys.argv[2] if len(sys.argv) == 3 else "attitude.png"
    estimates = {
        "live": recording.estimate("vqf"),
        "offline": recording.estimate("vqf", offline=True),
    }
    figure, axes = plt.subplots(3, sharex=True, figsize=(9, 7), layout="constrained")
    lines = {"reference": recording.reference} | estimates
    for name, quaternions in lines.items():
        for axis, values in zip(axes, zip(*map(angles_deg, quaternions))):
            axis.plot(recording.time_s, values, ".", markersize=1, label=name)
    for axis, name in zip(axes, ("roll", "pitch", "yaw")):
        axis.set_ylabel(f"{name}, deg")
        axis.grid(alpha=0.3)
    axes[0].legend(markerscale=8, loc="upper right")
    axes[-1].set_xlabel("time, s")
    figure.savefig(image, dpi=150)
    print(f"plot: {image}")
    for name, quaternions in estimates.items():
        score = recording.score(quaternions)
        if score:
            print("{}: total {:.3f}, heading {:.3f}, inclination {:.3f} deg RMSE".format(name, *score))


if __name__ == "__main__":
    main()

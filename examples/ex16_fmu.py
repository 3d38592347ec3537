"""Export the finger as an FMU and simulate it in FMPy, without this package.

Needs `pip install "continuum-grasp[fmu]"`. A tendon at a constant offset bends a weightless finger evenly, so that
it comes to rest as an arc of the angle tension * offset * L / EI.
"""

import argparse
import tempfile

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

try:
    import fmpy
except ImportError:
    raise SystemExit('this example needs fmpy: pip install "continuum-grasp[fmu]"') from None


def main(out=None):
    length, stiffness, offset, tension = 0.2, 6e-3, 0.005, 6.0  # m, N m2, m, N
    scene = cg.Scene(
        finger={
            "rod": {"length": length, "linear_density": 0.03, "bending_stiffness": stiffness},
            "damping": {"material": 1e-4},
            "tendons": {"offset": offset, "max_tension": 20.0, "time_constant": 0.02},
        },
        gravity=(0.0, 0.0),
        actuation={"tensions": [0.0, 0.0]},
        time={"duration": 1.0, "step": 1e-3},
    )
    times = np.array([0.0, 0.1, 0.2, 1.0])
    columns = {"time": times, "input.tension_1": [0.0, 0.0, tension, tension], "input.tension_2": [0.0] * 4}
    pull = np.rec.fromarrays(list(columns.values()), names=list(columns))
    with tempfile.TemporaryDirectory() as folder:
        (unit,) = cg.export_fmu(scene, folder, fmi=["2"], name="finger")
        outputs = ["tip.x", "tip.y", "tip.angle"]
        motion = fmpy.simulate_fmu(str(unit.file), input=pull, output=outputs, stop_time=1.0, output_interval=5e-3)

    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(motion["time"], 1e3 * motion["tip.x"], label="x")
    plt.plot(motion["time"], 1e3 * motion["tip.y"], label="y")
    plt.gca().set(xlabel="time [s]", ylabel="tip [mm]")
    plt.legend()
    if out:
        plt.savefig(out)
    found, expected = motion["tip.angle"][-1], tension * offset * length / stiffness
    print(f"tip turned by {found:.5f} rad, expected {expected:.5f} rad")
    assert abs(found / expected - 1.0) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))

"""Describe your own finger by its sections: here a cast cone, four times as thick at its base as at its tip.

Its first frequency comes from Bessel functions: G. Kirchhoff, Über die Transversalschwingungen eines Stabes von
veränderlichem Querschnitt, Monatsberichte der Akademie der Wissenschaften zu Berlin (1879) 815-828.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

import continuum_grasp as cg

SLENDER = 0.25  # tip per base diameter [1]


def determinant(k):
    """Zero where a cone, x from its point, can vibrate: w = J2(2 k sqrt(x)) / x and so on, clamped at x = 1."""
    z = 2.0 * k * np.sqrt(SLENDER)
    deflection, slope = ([f(order, 2.0 * k) for f in (jv, yv, iv, kv)] for order in (2, 3))
    force, moment = ([f(order, z) for f in (jv, yv, iv, kv)] for order in (3, 4))
    return np.linalg.det([deflection, np.multiply([-1, -1, 1, -1], slope), moment, np.multiply([1, 1, 1, -1], force)])


def main(out=None):
    length, base = 0.2, 0.02  # m
    material = {"youngs_modulus": 2e6, "density": 1100.0}  # Pa, kg/m3: silicone
    cone = cg.Rod(length=length, sections=[{"to": length, "diameter": [base, SLENDER * base]}], **material)
    modes = cg.modes(cg.Scene(finger=cg.Finger(rod=cone), gravity=(0.0, 0.0), fidelity={"elements": 4}))
    unit = 0.25 * base / length**2 * np.sqrt(material["youngs_modulus"] / material["density"])  # rad/s

    places, across = modes.backbone[:, 1], modes.shapes[0][:, 0]
    half = 0.5e3 * base * (1.0 + (SLENDER - 1.0) * places / length)
    middle = 40.0 * across / np.abs(across).max()
    plt.figure(figsize=(4.2, 2.6), layout="constrained")
    plt.fill_between(1e3 * places, -half, half, color="0.8", label="at rest")
    plt.fill_between(1e3 * places, middle - half, middle + half, alpha=0.6, label="first mode, enlarged")
    plt.gca().set(xlabel="mm", ylabel="mm", aspect="equal", ylim=(-70.0, 20.0))
    plt.legend(loc="lower left")
    if out:
        plt.savefig(out)
    found = 2.0 * np.pi * modes.frequencies_hz[0] / unit
    expected = (brentq(determinant, 2.5, 4.0) * (1.0 - SLENDER)) ** 2
    print(f"frequency factor {found:.4f}, expected {expected:.4f}")
    assert abs(found / expected - 1.0) < 0.005
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))

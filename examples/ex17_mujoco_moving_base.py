"""Put the finger on a moving base in MuJoCo: a chain of hinges on a cart with a constant acceleration.

Needs `pip install "continuum-grasp[mujoco]"`. Seen from the cart the finger bears the load rho A a per length, so that
the tip of the linear cantilever comes to rest rho A a L^4 / (8 E I) behind.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

try:
    import mujoco
except ImportError:
    raise SystemExit('this example needs mujoco: pip install "continuum-grasp[mujoco]"') from None

LENGTH, DENSITY, STIFFNESS, ACCELERATION = 0.2, 0.03, 6e-3, 2.0  # m, kg/m, N m2, m/s2


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=DENSITY, bending_stiffness=STIFFNESS)
    finger = cg.Finger(rod=rod, damping=cg.Damping(material=1e-4))
    scene = cg.Scene(finger=finger, gravity=(0.0, 0.0), time={"duration": 1.0, "step": 1e-3})
    spec = mujoco.MjSpec.from_string(cg.export_mjcf(scene, hinges=30).text)
    spec.delete(spec.keys[0])  # which has no cart
    cart = spec.worldbody.first_body()
    cart.mass, cart.inertia, cart.explicitinertial = 1e3, [1.0, 1.0, 1.0], True  # kg, kg m2: so heavy, it moves evenly
    cart.add_joint(name="cart", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = model.body_subtreemass[0] * ACCELERATION  # N
    times, behind = [], []
    while data.time < 0.8:
        mujoco.mj_step(model, data)
        times.append(data.time)
        behind.append(data.body(cart.name).xpos[0] - data.site("tip").xpos[0])

    expected = DENSITY * ACCELERATION * LENGTH**4 / (8.0 * STIFFNESS)
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(times, 1e3 * np.array(behind))
    plt.axhline(1e3 * expected, color="k", ls=":")
    plt.gca().set(xlabel="time [s]", ylabel="tip behind the cart [mm]")
    if out:
        plt.savefig(out)
    print(f"tip {1e3 * behind[-1]:.4f} mm behind, expected {1e3 * expected:.4f} mm")
    assert abs(behind[-1] / expected - 1.0) < 0.01
    return behind[-1], expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))

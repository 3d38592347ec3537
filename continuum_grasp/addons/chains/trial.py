"""Try a hand's grasp in MuJoCo: hold, turn, push by most of the promised push, and close; or only hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from continuum_grasp.addons.chains.hands import CLOSES, hand_chain
from continuum_grasp.base import Array, InputError

HOLDS = 2.0
"""Time in which the object must stay [s]."""
HOLDS_ONLY = 0.5
"""Duration of a trial that only holds the object [s]: a free object falls by 1.2 m in this time."""
MOVES, TURNS = 1e-3, math.radians(1.0)
"""Displacement [m] and turn [rad] from which on an object is not held."""
SHARE = 0.8
"""Part of the promised force that pushes: nearer to the edge of the cones MuJoCo's friction creeps."""
YIELDS = 1.5
"""Motion under a push, per motion of the linear response, from which on the object is lost: of five shipped hands it is
0.6 to 1.4 in 30 pushes."""
PUSH = (0.15, 0.25, 0.15, 0.15)
"""Times in which a push grows, lasts, fades, and is waited for [s]; a finger settles in a tenth of a second."""
TURN = (0.5, 0.5)
"""Times in which the weight turns to a direction, and stays there [s]."""
_MEAN = 0.25
"""Part at the end of the hold over which normal forces are averaged."""
_STEPS = 10
"""Steps after which the object is looked at."""
AXES = {
    f"{sign}{name}": factor * axis
    for sign, factor in (("+", 1.0), ("-", -1.0))
    for name, axis in zip("xyz", np.eye(3), strict=True)
}
"""Directions of pushes and of the weight."""


class HandInMujoco:
    """The exported model of a grasp, in its posture.

    Attributes
    ----------
    model, data
        Of MuJoCo.
    chain : HandChain
    """

    def __init__(self, result: Any) -> None:
        try:
            import mujoco
        except ImportError:
            raise InputError("MuJoCo is not installed: pip install 'continuum-grasp[mujoco]'", key="--try-in") from None
        self.mujoco = mujoco
        self.result = result
        self.chain = hand_chain(result)
        self.model = mujoco.MjModel.from_xml_string(self.chain.text)
        self.data = mujoco.MjData(self.model)
        self.weight = self.model.opt.gravity.copy()
        self.body = self.model.body("object").id
        names = [setup.name for setup in result.scene.setups]
        links = range(self.chain.hinges + 1)
        self.owner = {self.model.geom(f"{name}_{k}").id: (name, k) for name in names for k in links}
        self.supports = {self.model.geom(f"support_{each.name}").id: each.name for each in result.scene.supports}
        self.reset()

    def reset(self, key: str = "grasp") -> None:
        """Go back to a keyframe."""
        self.mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(key).id)
        self.model.opt.gravity = self.weight
        self.mujoco.mj_forward(self.model, self.data)
        self.start = self._pose()

    def _pose(self) -> tuple[Array, Array]:
        body = self.data.body("object")
        return body.xipos.copy(), body.xmat.reshape(3, 3).copy()

    @property
    def moved(self) -> Array:
        """Displacement of the object's center of mass [m] and its turn as a vector [rad] since the start (6,)."""
        place, axes = self._pose()
        first, before = self.start
        turn = axes @ before.T
        most = float(self.away[1])
        about = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate([place - first, about * most / max(2.0 * math.sin(most), 1e-300)])

    @property
    def away(self) -> Array:
        """Displacement of the object's center of mass [m] and its turn [rad] since the start (2,)."""
        place, axes = self._pose()
        first, before = self.start
        cosine = 0.5 * (float(np.sum(axes * before)) - 1.0)
        return np.array([np.linalg.norm(place - first), math.acos(min(max(cosine, -1.0), 1.0))])

    def run(self, seconds: float, before: Callable[[float], None] | None = None) -> Iterator[float]:
        """Run for a time; ``before`` is called with the share of it that is over, which is yielded too."""
        count = max(1, round(seconds / self.model.opt.timestep / _STEPS))
        for k in range(count):
            if before is not None:
                before((k + 1) / count)
            self.mujoco.mj_step(self.model, self.data, nstep=_STEPS)
            bad = self.data.warning[self.mujoco.mjtWarning.mjWARN_BADQACC].number
            if bad or not np.isfinite(self.data.qpos).all():
                raise FloatingPointError("the motion is unstable")
            yield (k + 1) / count

    def farthest(self, seconds: float, before: Callable[[float], None] | None = None) -> Array:
        """Greatest displacement [m] and turn [rad] of the object within a time (2,)."""
        return np.asarray(np.max([self.away for _ in self.run(seconds, before)], axis=0))

    def normal_forces(self) -> Array:
        """Normal forces (C,) near the stations of the plan [N]."""
        contacts = self.result.contacts
        found = np.zeros(len(contacts))
        force = np.zeros(6)
        for k, contact in enumerate(self.data.contact):
            touching = next((self.owner[geom] for geom in contact.geom if geom in self.owner), None)
            if touching is None:
                touched = next((self.supports[geom] for geom in contact.geom if geom in self.supports), "")
                self.mujoco.mj_contactForce(self.model, self.data, k, force)
                # Of several points none is determined, but their sum is: they share it as planned.
                planned = np.array([c.normal_force * c.name.startswith(f"{touched}_") for c in contacts])
                found += force[0] * planned / max(float(planned.sum()), 1e-300)
                continue
            self.mujoco.mj_contactForce(self.model, self.data, k, force)
            name, link = touching
            setup = next(s for s in self.result.scene.setups if s.name == name)
            at = link * setup.finger.rod.length / self.chain.hinges
            near = [(abs(c.station - at), i) for i, c in enumerate(contacts) if c.name.rpartition(".")[0] == name]
            if near:
                found[min(near)[1]] += force[0]
        return found

    def hold(self, seconds: float = HOLDS) -> tuple[Array, Array]:
        """Greatest displacement [m] and turn [rad] of the object at constant tensions (2,); mean normal forces (C,).

        The trial ends when the object is lost, after a displacement of its own size; the forces are then zero.
        """
        self.reset()
        worst = np.zeros(2)
        forces = list[Array]()
        for share in self.run(seconds):
            worst = np.maximum(worst, self.away)
            if worst[0] > self.result.scene.object.size:
                return worst, np.zeros(len(self.result.contacts))
            if share > 1.0 - _MEAN:
                forces.append(self.normal_forces())
        return worst, np.mean(forces, axis=0)

    def push(self, force: Array) -> tuple[Array, Array]:
        """Displacement [m] and turn [rad] of the object under a push at its center of mass, and after it."""
        self.reset()
        grows, lasts, fades, waits = PUSH

        def press(share: float) -> None:
            self.data.xfrc_applied[self.body, :3] = share * force

        self.farthest(grows, press)
        under = self.farthest(lasts)
        self.farthest(fades, lambda share: press(1.0 - share))
        self.farthest(waits)
        return under, self.away

    def turn(self, gravity: float) -> Iterator[tuple[str, Array]]:
        """Greatest displacement [m] and turn [rad] (2,) where gravity [m/s2] acts along each axis in turn."""
        self.reset()
        last = np.zeros(3)
        for name, axis in AXES.items():
            # Through a third direction where the next one is opposite.
            between = axis if last @ axis > -0.9 else np.roll(axis, 1)

            def weigh(share: float, ends: tuple[Array, Array, Array] = (last, between, axis)) -> None:
                first, second, third = ends
                along = (1.0 - share) ** 2 * first + 2.0 * share * (1.0 - share) * second + share**2 * third
                size = float(np.linalg.norm(along)) if first.any() else 1.0
                self.model.opt.gravity = gravity * along / size

            turns, stays = TURN
            self.farthest(turns, weigh)
            yield name, self.farthest(stays)
            last = axis

    def close(self) -> Array:
        """Displacement [m] and turn [rad] of the object after fingers closed around it from straight (2,)."""
        self.reset("open")
        self.data.eq_active[:] = 1

        def pull(share: float) -> None:
            self.data.ctrl[:] = self.chain.controls(CLOSES * share)[0]

        for _ in self.run(CLOSES, pull):
            pass
        for _ in self.run(0.3 * CLOSES):  # until the fingers rest
            pass
        self.data.eq_active[:] = 0
        return self.farthest(0.5 * HOLDS)


def try_in_mujoco(
    result: Any, progress: Callable[[str], None] | None = None, *, hold_only: bool = False
) -> dict[str, Any]:
    """Try a hand's grasp in MuJoCo; return plain data: ``holds``, the verdict in words, and the measured numbers.

    With ``hold_only`` the trial starts in the posture of the grasp and lasts `HOLDS_ONLY` seconds at constant tensions,
    without turns, pushes or closing.
    """
    hand = HandInMujoco(result)
    say = progress or (lambda _: None)
    try:
        return _tried(hand, say, hold_only)
    except FloatingPointError as error:
        return {"holds": False, "words": f"{_verdict([str(error)], hold_only)}: {error}"}


def _tried(hand: HandInMujoco, say: Callable[[str], None], hold_only: bool) -> dict[str, Any]:
    result = hand.result
    limits = np.array([MOVES, TURNS])
    seconds = HOLDS_ONLY if hold_only else HOLDS
    say(f"held for {seconds:g} s")
    worst, forces = hand.hold(seconds)
    planned = np.array([contact.normal_force for contact in result.contacts])
    off = float(np.abs(forces - planned).max() / planned.max())
    found: dict[str, Any] = {
        "moved": worst[0],
        "turned": worst[1],
        "normal_forces": dict(zip(result.contact_names, forces, strict=True)),
        "normal_force_error": off,
    }
    wrong = [] if (worst < limits).all() else [f"moves by {_words(worst)} within {seconds:g} s"]
    words = [f"moved {_words(worst)} in {seconds:g} s", f"normal forces within {off:.1%} of the greatest planned force"]
    words += [hand.chain.object_difference] if hand.chain.object_difference else []
    if hold_only:
        words_said = f"{_verdict(wrong, hold_only)}: {'; '.join(wrong or words)}"
        return {"holds": not wrong, "words": words_said, "hold_only": True, **found}
    if not wrong and result.scene.turned:
        say("turned")
        by_axis = dict(hand.turn(result.scene.turned))
        found["weights"] = {name: {"moved": away[0], "turned": away[1]} for name, away in by_axis.items()}
        most = np.max(list(by_axis.values()), axis=0)
        words.append(f"{_words(most)} with the weight along six axes")
        for name, away in by_axis.items():
            weight = result.scene.turned * result.scene.object.weighed * AXES[name]
            response = result.certificate.compliance[:, :3] @ weight
            linear = np.array([np.linalg.norm(response[:3]), np.linalg.norm(response[3:])])
            if (away > YIELDS * linear + limits).any():
                wrong.append(f"moves by {_words(away)} with the weight along {name}, {_words(linear)} to first order")
    pushes = {}
    for name, axis in AXES.items() if not wrong else ():
        say(f"pushed along {name}")
        # No more than any contact may bear, where none of them limits the push.
        force = SHARE * min(result.certificate.push, result.scene.contacts.normal_force_max) * axis
        under, after = hand.push(force)
        response = result.certificate.compliance[:, :3] @ force
        linear = np.array([np.linalg.norm(response[:3]), np.linalg.norm(response[3:])])
        held = bool((under < YIELDS * linear + limits).all() and (after < limits).all())
        pushes[name] = {"force": float(np.linalg.norm(force)), "held": held}
        pushes[name] |= {"moved": under[0], "turned": under[1], "moved_after": after[0], "turned_after": after[1]}
    if pushes:
        count = sum(push["held"] for push in pushes.values())
        words.append(f"{count} of {len(pushes)} pushes of {SHARE:.0%} of the promise held")
        wrong += [
            f"a push of {push['force']:.3g} N along {n} is not held" for n, push in pushes.items() if not push["held"]
        ]
        found["pushes"] = pushes
    if not wrong:
        say("closed from straight fingers")
        closed = hand.close()
        found["closed"] = {"moved": closed[0], "turned": closed[1]}
        words.append(f"after fingers that were straight closed, the object settles within {_words(closed)}")
    return {"holds": not wrong, "words": f"{_verdict(wrong, hold_only)}: {'; '.join(wrong or words)}", **found}


def _verdict(wrong: list[str], hold_only: bool) -> str:
    """Say whether the hand holds the object, and which parts of the trial were skipped."""
    untried = " (only held, from the posture of the grasp at its tensions; pushes, turns and closing were not tried)"
    return f"{'not held' if wrong else 'held'} in MuJoCo{untried if hold_only else ''}"


def _words(away: Array) -> str:
    return f"{1e3 * away[0]:.2g} mm and {math.degrees(away[1]):.2g} deg"

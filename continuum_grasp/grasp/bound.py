"""A lower bound on the greatest normal force of any grasp of a scene, from the balance of the object alone.

Let t be the greatest normal force, and S_i the forces and moments that contact i may apply with N = 1 at any place that
it may have. Balance asks for sum N_i s_i = b with s_i in S_i and 0 <= N_i <= t. For any multipliers y,

    y . b = sum N_i y . s_i <= t sum h_i(y),    h_i(y) = max(0, max over S_i of y . s),

so y . b / sum h_i(y) bounds t from below, whatever y (weak duality: S. Boyd and L. Vandenberghe, "Convex Optimization",
2004, section 5.1). The best y comes from cutting planes (J. E. Kelley, J. SIAM 8 (1960), doi:10.1137/0108053):

1. At y find h_i(y) from above, and the s that comes closest to it, for every contact.
2. Each s is a plane below h_i; the least sum of all planes so far is a linear problem, whose solution is the next y.
3. End where the planes leave a gap of `NEAR`, or where it is known on which side of a limit the bound is.

At a place p with the normal n and t across it,

    y . s = g . n + mu sqrt((g . t)^2 + g_z^2),   g = y_force + y_moment x p,   n and t in the plane,

is the most within the friction cone; over the places of an outline it is found by bisecting intervals, with what the
function can rise by inside them added, so that the bound holds between samples, too.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array, check_arguments
from continuum_grasp.grasp.object_supports import object_outlines, support_contacts, touching_supports
from continuum_grasp.grasp.quality.conic import FAR, solve_conic
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.values import NEAR, SAME
from continuum_grasp.model import PartOutline
from continuum_grasp.scene import GraspScene, Wall

_PIECES, _ROUNDS = 40, 40
"""Intervals of an outline to begin with: in each the normal turns by about 9 degrees, far less than 180; a hundred
times as many may hold a maximum at most, at a flat one the bound is looser. Most rounds of cutting planes (shipped
scenes take 23 at most), and of bisections. Cutting planes are added up to a gap of `NEAR`, intervals bisected
until an upper bound of h is its value at a place up to `SAME`."""


@check_arguments
def least_normal_force_bound(scene: GraspScene) -> float:
    """Compute a lower bound on the greatest normal force of any grasp of a scene.

    It follows from the balance of the object, friction cones, and how far each finger reaches. It ignores shapes
    of fingers, tendons and clearance, so it depends on no posture and no start. It is rigorous, and exact where the
    contacts can be where balance needs them: for n equal contacts that only lift it is m g / (n mu).

    Parameters
    ----------
    scene : GraspScene
        The scene; its objective does not matter.

    Returns
    -------
    float
        The bound [N]; zero without weight.

    Examples
    --------
    A tin of 0.2 kg between two tips, its weight out of the plane, a friction coefficient of 0.5: m g / (2 mu) [N].

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.grasp import least_normal_force_bound
    >>> round(least_normal_force_bound(cg.load("configs/grasp/pinch_above.yaml")), 2)
    1.96
    """
    return _bound(scene, math.nan)


def _bound(scene: GraspScene, limit: float) -> float:
    """The bound, or, where there is a limit, no more than on which side of that it is."""
    if scene.weight == 0.0:
        return 0.0
    need, contacts = _load(scene), _contacts(scene)
    used = np.isin(np.arange(6), scene.balances).astype(float)
    y = need / float(need @ need)
    least = math.inf
    value = 0.0
    cuts: list[list[Array]] = [[] for _ in contacts]
    for _ in range(_ROUNDS):
        bounds = [contact.most(y) for contact in contacts]
        least = min(least, sum(bound for bound, _ in bounds))
        for mine, (_, effect) in zip(cuts, bounds, strict=True):
            mine.append(effect)
        # What the cuts leave is the least that there may be, so that further ones end above it.
        if least - value <= NEAR * least or least * limit < scene.weight or value * limit > scene.weight:
            break
        y, value = _best_multipliers(need, used, cuts)
        if not np.isfinite(value):
            break
    return scene.weight / least if least > 0.0 else math.inf


def cannot_balance(scene: GraspScene) -> bool:
    """Whether forces within their cones and limits cannot balance the object, wherever fingers may touch it: a proof
    that there is no grasp, by `least_normal_force_bound`.
    """
    limits = [setup.normal_force_max for setup in scene.setups]
    limits += [scene.normal_force_max(body.name) for body in scene.places if body.touch != "off"]
    limit = (1.0 + SAME) * max(limits)
    return _bound(scene, limit) > limit


def _best_multipliers(need: Array, used: Array, cuts: list[list[Array]]) -> tuple[Array, float]:
    """Multipliers (6,) with the least sum of h by the cutting planes so far, and this sum; NaN where there is none."""
    count = len(cuts)
    planes = [np.concatenate([-effect, np.eye(count)[k]]) for k, mine in enumerate(cuts) for effect in mine]
    rows = np.array([*planes, np.concatenate([need, np.zeros(count)])])
    low = np.zeros(len(rows))
    high = np.full(len(rows), np.inf)
    low[-1] = high[-1] = 1.0
    # Any multipliers are valid.
    far = FAR * used / np.linalg.norm(need)
    cost = np.repeat([0.0, 1.0], [6, count])
    upper = np.concatenate([far, np.full(count, np.inf)])
    optimum = solve_conic(cost, rows, low, high, np.concatenate([-far, np.zeros(count)]), upper)
    return optimum.x[:6], optimum.objective


def _turns(scene: GraspScene) -> bool:
    """Whether the object's angle may be chosen: places on it have no fixed normals and arms then."""
    return scene.object.free is not None and scene.object.free.angle is not None


def _load(scene: GraspScene) -> Array:
    """Load on the contacts, per weight: force and moment (6,), as the object sees it where its angle is known."""
    along = complex(*scene.gravity[:2]) * (1.0 if _turns(scene) else cmath.exp(-1j * scene.object.angle))
    return np.array([along.real, along.imag, scene.gravity[2], 0.0, 0.0, 0.0]) / math.hypot(*scene.gravity)


def _contacts(scene: GraspScene) -> list[_Places]:
    """All contacts that there may be: one that is off is as good as one without force."""
    body = scene.object
    pose = scene.object.pose
    com = complex(*scene.object.com)
    size = scene.object.size
    outlines = object_outlines(scene)

    def anywhere(friction: float, center: complex = 0j, reach: float = math.inf, half: float = 0.0) -> _Places:
        return _Places(friction, () if _turns(scene) else outlines, com, size, center, reach, half)

    contacts: list[_Places] = []
    for setup in scene.setups:
        x, y = setup.finger.base.position
        center = (complex(x, y) - complex(*pose[:2])) * cmath.exp(-1j * pose[2])
        half = setup.finger.profile.half_thickness.constant
        # Of a finger that is not as thick everywhere, the places themselves must be as near as its greatest thickness.
        farther, half = (0.0, half) if half is not None else (setup.finger.thickness_radius, 0.0)
        moves = setup.finger.base_shift + body.greatest_shift
        along = (*((m, setup.middle_bounds[1]) for m in setup.middles), (setup.tip, setup.finger.rod.length))
        contacts += [
            anywhere(setup.held_friction, center, (1.0 + ROUNDING) * s + farther + moves, half)
            for switch, s in along
            if switch != "off"
        ]
    wanted = {support.name for support in scene.places if support.touch != "off"}
    if body.free is None:
        wanted &= touching_supports(scene, pose)
    for support in scene.places:
        if support.name not in wanted:
            continue
        friction = scene.held_friction(support.name)
        fixed = isinstance(support, Wall) and (body.free is None or math.isinf(support.half_length))
        if body.free is None or (fixed and not _turns(scene)):
            touched = support_contacts(scene, pose, (support.name,)).values()
            spots = [(complex(*at.point), at.normal_angle) for at in touched]
        elif fixed:
            # Two where a face may lie on it.
            ends = 2 if any(outline.face_normals for outline in outlines) else 1
            spots = [(com, support.normal_angle + math.pi)] * ends  # type: ignore[union-attr]
        else:
            contacts.append(anywhere(friction))
            continue
        contacts += [_Places(friction, (), com, size, spot=spot) for spot in spots]
    return contacts


@dataclass(frozen=True)
class _Places:
    """Possible places of a contact: on outlines, where the line of a finger that is ``half`` a thickness away is within
    reach of a point; without outlines, at the center of mass with any normal; or at one place with one normal.
    """

    friction: float
    outlines: tuple[PartOutline, ...]
    com: complex
    size: float
    center: complex = 0j
    reach: float = math.inf
    half: float = 0.0
    spot: tuple[complex, float] | None = None

    def most(self, y: Array) -> tuple[float, Array]:
        """An upper bound of h at multipliers (6,), and the effect (6,) of a contact that comes closest to it."""
        if self.spot is not None:
            work = self._work(y, *(np.array(part) for part in self.spot))
            return max(float(work), 0.0), self._effect(y, *self.spot)
        if not self.outlines:
            return self._any_normal(y)
        candidates = [self._along(y, outline) for outline in self.outlines]
        bound, at = max(candidates, key=lambda candidate: candidate[0])
        return max(bound, 0.0), np.zeros(6) if at is None else self._effect(y, *at)

    def _line(self, point: Array, angle: Array) -> Array:
        """Line of the finger that touches at points with normals, seen from the base."""
        return np.asarray(point + self.half * np.exp(1j * angle) - self.center)

    def _arms(self, y: Array, point: Array) -> tuple[Array, Array]:
        """Multiplier of a force at points: in the plane, as a complex number, and out of it."""
        arm = (point - self.com) / self.size
        return y[0] + 1j * y[1] + 1j * y[5] * arm, y[2] + y[3] * arm.imag - y[4] * arm.real

    def _work(self, y: Array, point: Array, angle: Array) -> Array:
        """The most y . s of forces with N = 1 in the friction cones at places with normals."""
        force, up = self._arms(y, point)
        along = force * np.exp(-1j * angle)
        return np.asarray(along.real + self.friction * np.hypot(along.imag, up))

    def _effect(self, y: Array, point: complex, angle: float) -> Array:
        """Effect on the object of the force with this maximum."""
        force, up = self._arms(y, np.array(point))
        across = float((force * cmath.exp(-1j * angle)).imag)
        size = math.hypot(across, float(up)) or 1.0
        push = cmath.exp(1j * angle) * (1.0 + 1j * self.friction * across / size)
        out = self.friction * float(up) / size
        arm = (point - self.com) / self.size
        moment = (arm.conjugate() * push).imag
        return np.array([push.real, push.imag, out, arm.imag * out, -arm.real * out, moment])

    def _any_normal(self, y: Array) -> tuple[float, Array]:
        force = complex(y[0], y[1])
        up = float(y[2])
        mu = self.friction
        size = abs(force)
        # Where g c + mu sqrt(g^2 (1 - c^2) + v^2) has its greatest value, c being the cosine of force and normal.
        cosine = min(1.0, math.sqrt((size**2 + up**2) / (1.0 + mu**2)) / size) if size > 0.0 else 1.0
        angle = cmath.phase(force) - math.acos(cosine)
        work = self._work(y, np.array([self.com]), np.array([angle]))
        return float(work[0]), self._effect(y, self.com, angle)

    def _along(self, y: Array, outline: PartOutline) -> tuple[float, tuple[complex, float] | None]:
        """Upper bound on an outline, and place and normal angle where the most was found, if more than zero."""
        # The normal jumps at no place inside an interval, whose last place is before a jump.
        ends = np.unique(np.concatenate([np.linspace(0.0, outline.period, _PIECES + 1), outline.breaks]))
        low = ends[:-1]
        high = ends[1:]
        steep = math.hypot(1.0, self.friction)
        best = 0.0
        bound = 0.0
        at = None
        for _ in range(_ROUNDS):
            before = np.where(np.isin(high, outline.breaks), np.nextafter(high, low), high)
            first, last = outline.walk(low), outline.walk(before)
            turn = np.abs(np.angle(np.exp(1j * (last.angle - first.angle))))
            lines = np.stack([self._line(first.point, first.angle), self._line(last.point, last.angle)])
            # A convex arc is no longer than its chord over the cosine of half its turn; half of it is near either end.
            bow = 0.5 / np.maximum(np.cos(0.5 * turn), 0.1)
            way = bow * np.abs(last.point - first.point)
            near = np.abs(lines).min(axis=0) - bow * np.abs(lines[1] - lines[0]) <= self.reach
            if not near.any():
                return (1.0 + SAME) * best, at
            low = low[near]
            high = high[near]
            turn = turn[near]
            way = way[near]
            lines = lines[:, near]
            points = np.stack([first.point[near], last.point[near]])
            angles = np.stack([first.angle[near], last.angle[near]])
            works = self._work(y, points, angles)
            there = np.where(np.abs(lines) <= self.reach, works, 0.0)
            end, row = np.unravel_index(int(np.argmax(there)), works.shape)
            if there[end, row] > best:
                best = float(there[end, row])
                at = (complex(points[end, row]), float(angles[end, row]))
            force, _ = self._arms(y, points)
            # The work is Lipschitz in both multipliers; turning the normal is turning the force.
            rise = steep * (abs(y[5]) * way / self.size + np.abs(force).max(axis=0) * turn)
            rise += self.friction * math.hypot(y[3], y[4]) * way / self.size
            upper = works.max(axis=0) + rise
            bound = max((1.0 + SAME) * best, float(upper.max()))
            wide = upper > (1.0 + SAME) * best
            if not wide.any() or wide.sum() > 100 * _PIECES:
                break
            low, high = low[wide], high[wide]
            middle = 0.5 * (low + high)
            low = np.concatenate([low, middle])
            high = np.concatenate([middle, high])
        return bound, at

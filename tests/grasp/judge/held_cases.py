"""Records of grasps for the certificate of rods: of stored arrays, of images, and with single numbers changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, HeldSupport, in_plane

MIRROR, ACROSS = np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0])


def held_plane(scene, arrays):
    """Record of a planar grasp by the arrays that `tests.certificate_cases` makes."""
    fingers = {setup.name: [] for setup in scene.setups}
    supports = []
    for k, name in enumerate(arrays["contact_names"].tolist()):
        normal = np.array([*arrays["contact_normals"][k], 0.0])
        pressed, along, lift = arrays["contact_forces"][k]
        # Lifts are on the object.
        force = pressed * normal + along * np.array([-normal[1], normal[0], 0.0]) - lift * np.array([0.0, 0.0, 1.0])
        owner = name.partition(".")[0]
        if owner in fingers:
            fingers[owner].append(HeldContact(name, force, place=float(arrays["contact_stations"][k])))
        else:
            supports.append(HeldSupport(name, force, np.array([*arrays["contact_positions"][k], 0.0])))
    held = tuple(
        HeldFinger(name, *in_plane(arrays[f"{name}.base"]), arrays[f"{name}.tensions"], tuple(contacts))
        for name, contacts in fingers.items()
    )
    return HeldRods(*in_plane(arrays["object.pose"]), held, tuple(supports))


def held_hand(scene, arrays):
    """Record of a hand's grasp by the arrays that `tests.hand_cases` makes."""
    fingers, supports = {setup.name: [] for setup in scene.setups}, []
    moments = arrays.get("contact_moments", np.zeros(len(arrays["contact_names"])))
    for k, name in enumerate(arrays["contact_names"].tolist()):
        owner, force = name.partition(".")[0], arrays["contact_forces"][k]
        if owner in fingers:
            place = float(arrays["contact_stations"][k])
            fingers[owner].append(HeldContact(name, force, place, float(moments[k])))
        else:
            supports.append(HeldSupport(name, force, arrays["contact_positions"][k]))
    bases = scene.hand.named_bases
    held = tuple(
        HeldFinger(name, *hand_base(bases[name]), arrays[f"{name}.tensions"], tuple(contacts))
        for name, contacts in fingers.items()
    )
    body = scene.object
    return HeldRods(np.array(body.position), body.axes, held, tuple(supports))


def hand_base(base):
    """Position and axes of a base in a hand."""
    along = np.array(base.direction) / np.linalg.norm(base.direction)
    bends = np.array(base.bends_toward) - along * (along @ np.array(base.bends_toward))
    bends = bends / np.linalg.norm(bends)
    return np.array(base.position), np.column_stack([-bends, along, np.cross(along, bends)])


def with_contact(held, name, **changes):
    """A record with numbers of a contact changed."""

    def changed(contacts):
        return tuple(replace(c, **changes) if c.name == name else c for c in contacts)

    fingers = tuple(replace(finger, contacts=changed(finger.contacts)) for finger in held.fingers)
    return replace(held, fingers=fingers, supports=changed(held.supports))


def contact_of(held, name):
    return next(contact for contact in held.contacts if contact.name == name)


def turned(held, turn, shift):
    """The record of the scene turned by a rotation matrix and then shifted."""

    def point(value):
        return turn @ value + shift

    def contacts(each):
        return tuple(replace(c, force=turn @ c.force) for c in each)

    fingers = tuple(
        replace(
            f,
            position=point(f.position),
            axes=turn @ f.axes,
            moment=None if f.moment is None else turn @ f.moment,
            contacts=contacts(f.contacts),
        )
        for f in held.fingers
    )
    supports = tuple(replace(c, force=turn @ c.force, position=point(c.position)) for c in held.supports)
    return replace(held, position=point(held.position), axes=turn @ held.axes, fingers=fingers, supports=supports)


def mirrored(held):
    """The record of the planar scene mirrored at the x axis: left and right tendons change places."""

    def contacts(each):
        return tuple(replace(c, force=MIRROR @ c.force) for c in each)

    # A rotation stays one, and Y the direction of the finger: X changes its sign.
    fingers = tuple(
        replace(
            f,
            position=MIRROR @ f.position,
            axes=MIRROR @ f.axes @ ACROSS,
            tensions=f.tensions[::-1],
            moment=None if f.moment is None else -MIRROR @ f.moment,
            contacts=contacts(f.contacts),
        )
        for f in held.fingers
    )
    return replace(
        held,
        position=MIRROR @ held.position,
        axes=MIRROR @ held.axes @ MIRROR,
        fingers=fingers,
        supports=tuple(replace(c, force=MIRROR @ c.force, position=MIRROR @ c.position) for c in held.supports),
    )

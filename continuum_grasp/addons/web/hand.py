"""The grasp of a hand as a page in space, which is drawn by WebGL and needs nothing but itself."""

from __future__ import annotations

import base64
import html
import json
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp import __version__
from continuum_grasp.addons.web.html_page import Page
from continuum_grasp.base import Array
from continuum_grasp.export import fill

_NODES = 49
"""Points along a finger that has no response."""
_MOST = 12_000
"""Triangles of the object at most: a page of 0.3 MB, which turns smoothly."""
_CELLS = 120
"""Cells along the object of the finest grid by which surfaces are thinned."""
_LENGTH = 0.3
"""Length of the greatest arrow, per length of the longest finger [1]."""
_SPAN = 0.3
"""Part by which sliders change tensions at most: beyond, the linear response says little."""


def hand_page(result: Any) -> Page:
    """The page of a grasp, or of a hand without one, whose fingers are straight."""
    name = result.scene.name or "a hand"
    words = {
        "title": html.escape(name),
        "status": html.escape(f"{result.status.word}: {result.message}"),
        "version": __version__,
        "known": json.dumps(_known(result)).replace("</", "<\\/"),
        "style": fill("web/page.css", {}) + fill("web/hand.css", {}),
        "script": fill("web/hand.js", {}),
        "responds": _response(result) is not None,
        "contacts": [html.escape(contact.name) for contact in result.contacts],
        "trial": html.escape(str(result.trial.get("words", ""))),
    }
    return Page(fill("web/hand.html", words), {})


def _response(result: Any) -> Any:
    """Linear response to tensions, where it is known and finite."""
    certificate = result.certificate
    # Certificates of rods do not know the response.
    if getattr(certificate, "hand", None) is None or not certificate.passed:
        return None
    response = certificate.response
    finite = all(np.isfinite(part).all() for part in (response.pose_by_tension, response.forces_by_tension))
    return response if finite else None


def _known(result: Any) -> dict[str, Any]:
    """Numbers that the page draws: lengths in millimeters."""
    scene = result.scene
    response = _response(result)
    lengths = [setup.finger.rod.length for setup in scene.setups]
    greatest = max((float(np.linalg.norm(contact.force)) for contact in result.contacts), default=1.0)
    known: dict[str, Any] = {
        "object": _surface(result.body),
        "center": _millimeters(scene.object.com),
        "arrow": 1e3 * _LENGTH * max(lengths) / greatest,
        "span": _SPAN,
        "fingers": [_finger(result, k, response) for k in range(len(lengths))],
        "contacts": [_contact(result, contact, response) for contact in result.contacts],
        "supports": [_support(result, support) for support in scene.supports],
        "pose": None,
        "tensions": [],
    }
    if response is not None:
        pose = response.pose_by_tension.copy()
        pose[:3] *= 1e3
        known["pose"] = _digits(pose)
        known["tensions"] = [_digits(pair) for pair in result.tensions.values()]
    return known


def _surface(body: Any) -> dict[str, Any]:
    """Corners [mm] and triangles of the object, packed: meshes have many."""
    corners, triangles = _thinned(*body.triangles())
    wide = len(corners) > np.iinfo(np.uint16).max
    return {
        "corners": _packed(1e3 * corners, "<f4"),
        "triangles": _packed(triangles, "<u4" if wide else "<u2"),
        "wide": wide,
    }


def _thinned(corners: Array, triangles: Array) -> tuple[Array, Array]:
    """A surface of fewer triangles: corners in one cell of a grid become their mean, of as fine a grid as will do."""
    cell = float(np.ptp(corners, axis=0).max()) / _CELLS
    while len(triangles) > _MOST:
        _, owner, count = np.unique(np.round(corners / cell), axis=0, return_inverse=True, return_counts=True)
        means = np.stack([np.bincount(owner.ravel(), column) for column in corners.T], axis=1) / count[:, None]
        triangles = owner.ravel()[triangles]
        a, b, c = triangles.T
        corners = means
        triangles = triangles[(a != b) & (b != c) & (c != a)]
        cell = 1.3 * cell
    return corners, triangles


def _packed(values: ArrayLike, kind: str) -> str:
    """Numbers as text."""
    return base64.b64encode(np.asarray(values).astype(kind).tobytes()).decode()


def _finger(result: Any, k: int, response: Any) -> dict[str, Any]:
    """Backbone of a finger, and its displacement by tensions."""
    setup = result.scene.setups[k]
    frame = result.frames[k]
    length = setup.finger.rod.length
    changes = None
    if response is not None:
        points = response.places[k]
        changes = _digits(1e3 * response.places_by_tension[k])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        at = length * np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    else:
        straight = np.array([[0.0] * 4, [length, 0.0, length, 0.0]])
        line = result.arrays[f"{setup.name}.backbone"] if result.arrays else straight
        at = np.linspace(0.0, length, _NODES)
        x, y = (np.interp(at, line[:, 0], column) for column in line.T[1:3])
        points = frame.world(np.column_stack([x, y, 0.0 * at]))
    radii = np.broadcast_to(setup.finger.profile.half_thickness(at), at.shape)
    return {"name": setup.name, "radii": _millimeters(radii), "points": _millimeters(points), "changes": changes}


def _support(result: Any, support: Any) -> dict[str, Any]:
    """Disc of a palm or table, of a plane that much of it which is below hand and object."""
    scene = result.scene
    normal = np.array(support.normal)
    center = np.array(support.point)
    radius = support.radius
    if np.isinf(radius):
        places = np.array([scene.object.position, *(frame.base for frame in result.frames)])
        places = places - ((places - center) @ normal)[:, None] * normal
        center = 0.5 * (places.min(axis=0) + places.max(axis=0))
        radius = float(np.linalg.norm(places - center, axis=1).max()) + scene.object.size
    return {"center": _millimeters(center), "normal": _digits(normal), "radius": 1e3 * radius}


def _contact(result: Any, contact: Any, response: Any) -> dict[str, Any]:
    """Place and force of a contact, and what tensions change of it; contacts that do not press have no response."""
    pressing = [] if response is None else [c.name for c in result.certificate.hand.pressing]
    changes = None
    if contact.name in pressing:
        changes = _digits(response.forces_by_tension[pressing.index(contact.name)])
    return {
        "name": contact.name,
        "at": _millimeters(contact.position),
        "normal": _digits(contact.normal),
        "force": _digits(contact.force),
        "friction": result.friction_of(contact.name),
        "changes": changes,
    }


def _millimeters(points: ArrayLike) -> Any:
    return np.round(1e3 * np.asarray(points), 2).tolist()


def _digits(values: ArrayLike) -> Any:
    """Numbers with five digits."""
    array = np.asarray(values, dtype=float)
    return np.array([float(f"{v:.5g}") for v in array.ravel()]).reshape(array.shape).tolist()

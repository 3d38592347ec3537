"""What the drives of a finger are commanded, by the names of the model's inputs."""

from __future__ import annotations

from typing import NamedTuple

from continuum_grasp.scene.simulate import Scene


class InputNames(NamedTuple):
    """The key of ``actuation``, the names of its entries in the model, and their unit."""

    key: str
    entries: tuple[str, ...]
    unit: str

    @property
    def several(self) -> bool:
        """Whether the key takes a list."""
        return self.key != "tip_moment"

    @staticmethod
    def of(scene: Scene) -> InputNames:
        """Those of a scene."""
        finger = scene.finger
        drives, tendons = finger.winches, finger.tendon_list
        if not tendons:
            return InputNames("tip_moment", ("tip_moment",), "N m")
        key = drives[0].key if drives else "tensions"
        units = {"tensions": "N", "lengths": "m", "torques": "N m", "currents": "A", "angles": "rad"}
        count = len(drives) or len(tendons)
        return InputNames(key, tuple(f"{key.removesuffix('s')}_{k + 1}" for k in range(count)), units[key])

"""Drawing primitives: axes, files, the object, its supports, the outline of a finger."""

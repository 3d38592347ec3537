"""Curves in drawings: files as other programs write them, and which of their curves is the outline of an object."""

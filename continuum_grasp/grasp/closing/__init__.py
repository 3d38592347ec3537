"""Closing a grasp: the way from open fingers to it."""

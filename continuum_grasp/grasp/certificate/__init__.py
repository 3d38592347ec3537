"""Verification of a grasp by numpy alone, apart from the search."""

"""A grasp result as one web page."""

"""A result in words, files and pages."""

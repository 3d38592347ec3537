"""Add-ons that come with the package: each is entered through its door, and uses the doors of the core alone."""

"""Pictures of plans and closed loops."""

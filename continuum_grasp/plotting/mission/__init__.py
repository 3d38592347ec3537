"""Pictures of missions."""

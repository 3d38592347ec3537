"""Pictures of simulations and modes."""

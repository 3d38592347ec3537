"""Error of a finger model against the exact rod, and the choice of a model by tolerance."""

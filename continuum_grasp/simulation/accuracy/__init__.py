"""Error of a finger model against the exact rod and against finer elements, and the choice of a model by tolerance."""

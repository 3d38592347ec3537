"""Cases that are hard for a model of a finger, each with a truth that the model did not produce."""

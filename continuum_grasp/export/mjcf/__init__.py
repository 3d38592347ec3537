"""The finger as a chain of hinges for MuJoCo."""

"""The exact elastic rod by numpy and scipy: the independent reference of the finger model."""

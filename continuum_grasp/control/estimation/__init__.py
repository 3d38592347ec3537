"""The extended Kalman filter of a controller, and moving horizon estimation as its check."""

"""C of controllers and estimators, compiled and called from Python."""

"""The optimal control problem of a controller: cost terms, bounds, setpoints, and the functions of its stages."""

"""Real-time iterations: linearization of the stages and solution of the QP that results, in C."""

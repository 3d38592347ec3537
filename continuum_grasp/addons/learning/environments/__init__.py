"""Reinforcement learning: closed loops as environments of gymnasium, many plants at once in compiled vector lanes."""

"""A whole grasp under control: what is to be done, the closed loop that does it, and many plants on which it must."""

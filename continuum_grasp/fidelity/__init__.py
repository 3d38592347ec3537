"""How accurate the finger model is: truth that shares nothing with it."""

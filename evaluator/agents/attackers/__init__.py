"""Generic attackers: strategies that answer without modelling the scene. Prediction tasks must defeat them."""

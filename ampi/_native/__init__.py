"""The compiled engine: flight code, plant and closed loop in C; without a compiler it is not there."""

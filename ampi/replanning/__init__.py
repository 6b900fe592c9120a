"""The rest of a flight, from where the vehicle is and with what is estimated, by the optimiser."""

"""The reference re-selected in flight from a table that knows density and lift, without a prediction."""

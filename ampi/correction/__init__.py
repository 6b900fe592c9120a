"""The plan that is flown, corrected in flight."""

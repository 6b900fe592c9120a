"""What is wrong with the model that flies, estimated in flight."""

"""The methods of the literature, as combinations of named parts."""

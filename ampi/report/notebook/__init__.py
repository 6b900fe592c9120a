"""How values show themselves in a notebook: sheets of words, sketches, plots and xarray."""

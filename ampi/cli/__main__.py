"""`python -m ampi.cli`."""

from ampi.cli import main

main()

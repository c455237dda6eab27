"""`python -m antway` does what the command `antway` does."""

from antway.cli import main

main()

"""`python -m skinlab` is `skinlab`."""

from skinlab.cli.main import main

main()

"""`python -m skinlab` is `skinlab`."""

from skinlab.cli.start import main

main()

"""`python -m skinlab` is `skinlab`."""

from skinlab.start import main

main()

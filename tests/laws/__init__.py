"""Laws that are no part of the package: what extensions are tried with."""
